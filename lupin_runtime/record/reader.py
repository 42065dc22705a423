"""Reads MCAP recordings, also compressed, truncated or damaged ones: readable messages are returned, and damage is listed.

This module parses the records itself, because the readers of the `mcap` package stop at the first defect and create an object
for every message, of which a mission's report skips nine tenths.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Header, Metadata, Schema

from lupin_runtime.bounded_file import open_regular
from lupin_runtime.record.unpacking import LZ4_MAGIC, ZSTD_MAGIC, Stream, open_unpacked, unpack_message

MAGIC = b"\x89MCAP0\r\n"
# Files that a user may take for a recording, by their first bytes, and what makes one of them.
_OTHERS = {
    b"SQLite f": ": it is rosbag2's sqlite3 storage; convert its folder to MCAP with: ros2 bag convert",
    b"#ROSBAG ": ": it is a ROS 1 bag; convert it with: rosbags-convert",
    b"\x1f\x8b": ": it is compressed by gzip; unpack it with: gunzip",
    b"BZh": ": it is compressed by bzip2; unpack it with: bunzip2",
    b"\xfd7zXZ": ": it is compressed by xz; unpack it with: unxz",
}

RECORD_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
CHUNK_HEAD = struct.Struct("<QQQII")  # start, end, uncompressed size, crc, length of the compression's name
# Far above the chunks of recorders, which hold 1 to 8 MB or one raw picture; a larger one is damage or an attack.
CHUNK_LIMIT_BYTES = 32 << 20
# Of a message that is decoded: above a picture of 8 megapixels. Python objects of a larger one may take ten times its size.
MESSAGE_LIMIT_BYTES = 24 << 20
RECORD_LIMIT_BYTES = 2 * CHUNK_LIMIT_BYTES  # of one record as it is in the file


class NotARecording(ValueError):
    """The file is not an MCAP file or cannot be opened; the message says what was found."""


@dataclass(frozen=True)
class ChannelInfo:
    """A topic of a recording; `type` is `package/msg/Name`, `qos` the text that the recorder stored with it."""

    topic: str
    type: str
    qos: str = ""


class RawMessage(NamedTuple):
    """A serialized message. At its arrival, `log_ns` was ROS time and `publish_ns` the wall clock."""

    topic: str
    log_ns: int
    publish_ns: int
    data: bytes


class Decoded(NamedTuple):
    """A deserialized message. At its arrival, `log_ns` was ROS time and `publish_ns` the wall clock."""

    topic: str
    log_ns: int
    publish_ns: int
    message: Any


@dataclass
class TopicCount:
    """The number and size of a topic's messages."""

    channel: ChannelInfo
    messages: int = 0
    bytes: int = 0


@dataclass
class Summary:
    """The content of a recording. `damage` is empty where the file is complete."""

    path: Path
    size_bytes: int
    start_ns: int
    end_ns: int
    topics: list[TopicCount]
    metadata: dict[str, str]
    damage: list[str] = field(default_factory=list)

    @property
    def duration_s(self) -> float:
        """Seconds from the first message to the last."""
        return max(0, self.end_ns - self.start_ns) / 1e9

    @property
    def messages(self) -> int:
        """The number of messages of all topics."""
        return sum(topic.messages for topic in self.topics)


class Recording:
    """One MCAP file. Each pass over it collects `channels`, `metadata` and `damage` again."""

    def __init__(self, path: Path) -> None:
        """Check that `path` is an MCAP file. Raises NotARecording."""
        self.path = path
        self.channels: dict[int, ChannelInfo] = {}
        self.metadata: dict[str, str] = {}
        self.damage: list[str] = []
        self._schemas: dict[int, str] = {}
        self._packed: Counter[str] = Counter()  # by topic: messages that could not be unpacked
        try:
            with open_unpacked(path) as (file, _):
                found = file.read(len(MAGIC))
        except OSError as error:
            raise NotARecording(f"{path}: {error.strerror}; expected an MCAP file") from error
        if found != MAGIC:
            other = next((text for start, text in _OTHERS.items() if found.startswith(start)), "")
            what = f"it begins with {found!r}{other}" if found else "it is empty"
            raise NotARecording(f"{path} is not an MCAP recording: {what}")

    def raw(self, topics: Collection[str] | None = None) -> Iterator[RawMessage]:
        """The serialized messages of these topics (None: all) in the order of the file.

        Messages that rosbag2 compressed are unpacked. It stops where the file is truncated and skips damaged chunks and
        messages; `damage` lists them afterwards.
        """
        self.channels, self.metadata, self.damage, self._schemas, self._packed = {}, {}, [], {}, Counter()
        with open_unpacked(self.path) as (file, size):
            file.seek(len(MAGIC))
            for opcode, data in self._records(file, size):
                if opcode == Opcode.CHUNK:
                    yield from self._chunk(data, topics)
                elif opcode == Opcode.MESSAGE:
                    yield from self._messages(RECORD_HEAD.pack(opcode, len(data)) + data, topics)
                else:
                    self._store(opcode, data)
        self.damage += [
            f"{topic}: {count} messages are compressed by zstd and cannot be unpacked"
            for topic, count in sorted(self._packed.items())
        ]

    def messages(
        self, topics: Collection[str] | None = None, max_rate_hz: Mapping[str, float] | None = None
    ) -> Iterator[Decoded]:
        """Like `raw`, but deserialized. `max_rate_hz` drops messages before that.

        Topics of unknown types, and messages that do not fit their topic's type, are skipped and listed in `damage`.
        """
        from rclpy.serialization import deserialize_message

        from lupin_runtime.ros.interfaces import interface

        kinds: dict[str, Any] = {}
        periods = {topic: int(1e9 / rate) for topic, rate in (max_rate_hz or {}).items()}
        due: dict[str, int] = {}
        unreadable: Counter[str] = Counter()
        too_large: Counter[str] = Counter()
        for item in self.raw(topics):
            if item.topic in periods:
                if item.log_ns < due.get(item.topic, 0):
                    continue
                due[item.topic] = item.log_ns + periods[item.topic]
            if item.topic not in kinds:
                type_name = next(c.type for c in self.channels.values() if c.topic == item.topic)
                try:
                    kinds[item.topic] = interface(type_name)
                except (ImportError, AttributeError, ValueError):
                    kinds[item.topic] = None
                    self.damage.append(f"{item.topic}: its type {type_name} is not installed on this machine")
            if (kind := kinds[item.topic]) is None:
                continue
            if len(item.data) > MESSAGE_LIMIT_BYTES:
                too_large[item.topic] += 1
                continue
            try:
                message = deserialize_message(item.data, kind)
            except (RuntimeError, ValueError, TypeError, AttributeError):  # rmw's error is a RuntimeError
                unreadable[item.topic] += 1
            else:
                yield Decoded(item.topic, item.log_ns, item.publish_ns, message)
        self.damage += [f"{topic}: {count} messages do not fit their type" for topic, count in sorted(unreadable.items())]
        self.damage += [
            f"{topic}: {count} messages of more than {MESSAGE_LIMIT_BYTES} bytes were left out"
            for topic, count in sorted(too_large.items())
        ]

    def summary(self) -> Summary:
        """Summarize the file in one pass."""
        counts: dict[str, TopicCount] = {}
        start_ns, end_ns = 0, 0
        for item in self.raw():
            if item.topic not in counts:
                start_ns = min(start_ns, item.log_ns) if counts else item.log_ns
                channel = next(c for c in self.channels.values() if c.topic == item.topic)
                counts[item.topic] = TopicCount(channel)
            count = counts[item.topic]
            count.messages += 1
            count.bytes += len(item.data)
            start_ns, end_ns = min(start_ns, item.log_ns), max(end_ns, item.log_ns)
        for channel in self.channels.values():
            counts.setdefault(channel.topic, TopicCount(channel))
        topics = sorted(counts.values(), key=lambda count: count.channel.topic)
        size = self.path.stat().st_size
        return Summary(self.path, size, start_ns, end_ns, topics, self.metadata, self.damage)

    # -- records ------------------------------------------------------------------------------------------------------
    def _records(self, file: Stream, size: int) -> Iterator[tuple[int, bytes]]:
        """The records of the data section, up to the point where a killed recorder truncated it."""
        while True:
            at = file.tell()
            head = file.read(RECORD_HEAD.size)
            if len(head) < RECORD_HEAD.size:
                self.damage.append("the file is incomplete: its recorder was killed, or the disk was full")
                return
            opcode, length = RECORD_HEAD.unpack(head)
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                return
            if length > size - at - RECORD_HEAD.size:
                self.damage.append(f"truncated in the middle of a record at byte {at} of {size}")
                return
            if length > RECORD_LIMIT_BYTES:
                self.damage.append(f"a record of {length} bytes at byte {at} was skipped: no recorder writes such")
                file.seek(length, io.SEEK_CUR)
                continue
            if opcode in (Opcode.CHUNK, Opcode.MESSAGE, Opcode.CHANNEL, Opcode.SCHEMA, Opcode.METADATA, Opcode.HEADER):
                if len(data := file.read(length)) < length:
                    self.damage.append(f"truncated in the middle of a record at byte {at}")
                    return
                yield opcode, data
            elif 0 < opcode <= max(Opcode) or opcode >= 0x80:
                file.seek(length, io.SEEK_CUR)
            else:
                self.damage.append(f"garbage at byte {at} of {size}: opcode {opcode}")
                return

    def _chunk(self, data: bytes, topics: Collection[str] | None) -> Iterator[RawMessage]:
        try:
            records = unpack_chunk(data)
        except (ValueError, struct.error, RuntimeError, zstandard.ZstdError) as error:
            self.damage.append(f"a chunk is damaged and was skipped: {error}")
            return
        yield from self._messages(records, topics)

    def _messages(self, records: bytes, topics: Collection[str] | None) -> Iterator[RawMessage]:
        at, end = 0, len(records)
        while at < end:
            opcode, length = RECORD_HEAD.unpack_from(records, at) if end - at >= RECORD_HEAD.size else (0, end)
            at += RECORD_HEAD.size
            if length > end - at or (opcode == Opcode.MESSAGE and length < _MESSAGE.size):
                self.damage.append("a chunk ends inside a record, or holds garbage")
                return
            if opcode == Opcode.MESSAGE:
                channel_id, _, log_ns, publish_ns = _MESSAGE.unpack_from(records, at)
                channel = self.channels.get(channel_id)
                if channel is not None and (topics is None or channel.topic in topics):
                    content = unpack_message(records[at + _MESSAGE.size : at + length], CHUNK_LIMIT_BYTES)
                    if content is None:
                        self._packed[channel.topic] += 1
                    else:
                        yield RawMessage(channel.topic, log_ns, publish_ns, content)
            else:
                self._store(opcode, records[at : at + length])
            at += length

    def _store(self, opcode: int, data: bytes) -> None:
        stream = ReadDataStream(io.BytesIO(data))
        try:
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(stream)
                self._schemas[schema.id] = schema.name
            elif opcode == Opcode.CHANNEL:
                channel = Channel.read(stream)
                type_name = self._schemas.get(channel.schema_id, "")
                qos = channel.metadata.get("offered_qos_profiles", "")
                self.channels[channel.id] = ChannelInfo(channel.topic, type_name, qos)
            elif opcode == Opcode.METADATA:
                self.metadata.update(Metadata.read(stream).metadata)
            elif opcode == Opcode.HEADER and (profile := Header.read(stream).profile) != "ros2":
                self.damage.append(f"its profile is {profile!r}, not 'ros2': its messages may not be ROS 2 messages")
        except (McapError, struct.error, UnicodeDecodeError) as error:
            self.damage.append(f"a {Opcode(opcode).name.lower()} record is damaged: {error}")


def begins_like_recording(path: Path) -> bool:
    """Return whether a file is an MCAP or packed one, or a recording in a format that `Recording` refuses. Raises OSError."""
    with open_regular(path) as file:
        return file.read(len(MAGIC)).startswith((MAGIC[:5], ZSTD_MAGIC, LZ4_MAGIC, b"SQLite f", b"#ROSBAG "))


def unpack_chunk(data: bytes) -> bytes:
    """The records of a chunk. Raises ValueError and the exceptions of the decompressors."""
    _, _, size, crc, name_length = CHUNK_HEAD.unpack_from(data)
    at = CHUNK_HEAD.size
    name = data[at : at + name_length]
    at += name_length
    (length,) = struct.unpack_from("<Q", data, at)
    packed = data[at + 8 : at + 8 + length]
    if len(packed) != length or size > CHUNK_LIMIT_BYTES:
        raise ValueError("inconsistent lengths")
    # The decompressors allocate the size that the frame itself claims, which may be any number in a damaged one.
    if name == b"zstd":
        if zstandard.frame_content_size(packed) > CHUNK_LIMIT_BYTES:
            raise ValueError("inconsistent lengths")
        records = zstandard.decompress(packed, max_output_size=size)
    elif name == b"lz4":
        decompressor = lz4.frame.LZ4FrameDecompressor()
        records = decompressor.decompress(packed, max_length=size)
        if not decompressor.eof:
            raise ValueError("inconsistent lengths")
    elif name == b"":
        records = packed
    else:
        raise ValueError(f"unknown compression {name[:16]!r}")
    if len(records) != size:
        raise ValueError("inconsistent lengths")
    if crc and zlib.crc32(records) != crc:
        raise ValueError("wrong checksum")
    return bytes(records)
