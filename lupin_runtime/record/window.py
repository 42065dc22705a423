"""Reads windows of a recording, also of one that is still being written, and unpacks only the chunks that a window needs."""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import zstandard
from mcap.opcode import Opcode

from lupin_runtime.bounded_file import open_regular
from lupin_runtime.record.reader import CHUNK_HEAD, MAGIC, RECORD_HEAD, RawMessage, Recording, unpack_chunk

_CHANNEL_ID = struct.Struct("<H")


@dataclass
class _Chunk:
    """A chunk's place in the file, its times, and the channels of its messages; none if it has no index."""

    at: int
    length: int
    start_ns: int
    end_ns: int
    channels: set[int] = field(default_factory=set)


@dataclass(frozen=True)
class Window:
    """Messages of a recording in the order of their times.

    `start_ns` and `end_ns` are the recording's first and last time, 0 if it has no messages. `complete_ns` is the time up to
    which `messages` is complete: it is before the end of the window if that would have exceeded the size limit.
    """

    start_ns: int
    end_ns: int
    complete_ns: int
    messages: list[RawMessage]


class IndexedRecording(Recording):
    """A recording whose chunks are found without being unpacked. Messages outside of chunks are ignored."""

    def __init__(self, path: Path) -> None:
        """Check that `path` is an MCAP file. Raises NotARecording."""
        super().__init__(path)
        self._chunks: list[_Chunk] = []
        self._next = len(MAGIC)

    @property
    def extent_ns(self) -> tuple[int, int] | None:
        """The first and the last time; None if there are no messages."""
        if not self._chunks:
            return None
        return min(chunk.start_ns for chunk in self._chunks), max(chunk.end_ns for chunk in self._chunks)

    def refresh(self) -> None:
        """Read which chunks were appended since the last call. Raises OSError."""
        with open_regular(self.path) as file:
            size = self.path.stat().st_size
            while self._next + RECORD_HEAD.size <= size:
                file.seek(self._next)
                opcode, length = RECORD_HEAD.unpack(file.read(RECORD_HEAD.size))
                at = self._next + RECORD_HEAD.size
                if at + length > size or opcode in (Opcode.DATA_END, Opcode.FOOTER) or not 0 < opcode <= max(Opcode):
                    break  # the end, or a record of which a part is still to be written
                self._read_record(file, opcode, at, length)
                self._next = at + length
            self._learn_channels(file)

    def _read_record(self, file: BinaryIO, opcode: int, at: int, length: int) -> None:
        if opcode == Opcode.CHUNK and length >= CHUNK_HEAD.size:
            start_ns, end_ns, *_ = CHUNK_HEAD.unpack(file.read(CHUNK_HEAD.size))
            self._learn_channels(file)
            self._chunks.append(_Chunk(at, length, start_ns, end_ns))
        elif opcode == Opcode.MESSAGE_INDEX and self._chunks:
            (channel,) = _CHANNEL_ID.unpack(file.read(_CHANNEL_ID.size))
            self._chunks[-1].channels.add(channel)
            if channel not in self.channels:
                list(self._unpack(file, self._chunks[-1], ()))  # its definition comes before its first message
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA, Opcode.HEADER):
            self._store(opcode, file.read(length))

    def _learn_channels(self, file: BinaryIO) -> None:
        """Read the definitions in the last chunk if no index names its channels, as when the recorder was killed."""
        if self._chunks and not self._chunks[-1].channels:
            list(self._unpack(file, self._chunks[-1], ()))

    def between(self, topics: Collection[str], from_ns: int, to_ns: int) -> Iterator[RawMessage]:
        """The messages of these topics from one time to another, in the order of the file. Raises OSError."""
        ids = self._ids(topics)
        with open_regular(self.path) as file:
            for chunk in self._chunks:
                if chunk.start_ns <= to_ns and chunk.end_ns >= from_ns and _may_have(chunk, ids):
                    yield from (m for m in self._unpack(file, chunk, topics) if from_ns <= m.log_ns <= to_ns)

    def last_before(self, topics: Collection[str], at_ns: int) -> dict[str, RawMessage]:
        """The last message of each topic before a time; topics without one are missing. Raises OSError."""
        found: dict[str, RawMessage] = {}
        missing = set(topics)
        with open_regular(self.path) as file:
            for chunk in reversed(self._chunks):
                if not missing:
                    break
                if chunk.start_ns < at_ns and _may_have(chunk, self._ids(missing)):
                    found.update({m.topic: m for m in self._unpack(file, chunk, missing) if m.log_ns < at_ns})
                    missing -= found.keys()
        return found

    def type_of(self, topic: str) -> str | None:
        """The type of a topic as `package/msg/Name`; None if the recording does not have the topic."""
        return next((channel.type for channel in self.channels.values() if channel.topic == topic), None)

    def _ids(self, topics: Collection[str]) -> set[int]:
        return {number for number, channel in self.channels.items() if channel.topic in topics}

    def _unpack(self, file: BinaryIO, chunk: _Chunk, topics: Collection[str]) -> Iterator[RawMessage]:
        file.seek(chunk.at)
        try:
            records = unpack_chunk(file.read(chunk.length))
        except (ValueError, struct.error, RuntimeError, zstandard.ZstdError):
            return  # damaged: the messages around it are still shown
        yield from self._messages(records, topics)


def _may_have(chunk: _Chunk, ids: set[int]) -> bool:
    return not chunk.channels or not ids.isdisjoint(chunk.channels)


def read_window(
    recordings: Sequence[IndexedRecording],
    topics: Collection[str],
    from_ns: int,
    to_ns: int,
    all_before: Collection[str] = (),
    max_bytes: int = 8_000_000,
) -> Window:
    """Read what a view of the time from `from_ns` to `to_ns` needs: the messages of that time, and the state before it.

    The state is the last message of each topic before `from_ns`, and every one of the topics in `all_before`. `recordings` are
    those of one run, oldest first. The messages of the time have up to `max_bytes`; the state is never cut. Raises OSError.
    """
    for recording in recordings:
        recording.refresh()
    extents = [extent for recording in recordings if (extent := recording.extent_ns) is not None]
    if not extents:
        return Window(0, 0, 0, [])
    start_ns, end_ns = min(start for start, _ in extents), max(end for _, end in extents)
    kept = [topic for topic in all_before if topic in topics]
    state: dict[str, RawMessage] = {}
    every: list[RawMessage] = []
    for recording in reversed(recordings):
        missing = [topic for topic in topics if topic not in kept and topic not in state]
        state.update(recording.last_before(missing, from_ns))
        every += recording.between(kept, 0, from_ns - 1)
    messages = sorted([*state.values(), *every], key=_time)
    size = 0
    for message in sorted((m for recording in recordings for m in recording.between(topics, from_ns, to_ns)), key=_time):
        size += len(message.data)
        if size > max_bytes:
            return Window(start_ns, end_ns, message.log_ns - 1, messages)
        messages.append(message)
    return Window(start_ns, end_ns, min(to_ns, end_ns), messages)


def _time(message: RawMessage) -> int:
    return message.log_ns
