"""Writes one MCAP file of which every flushed message stays readable, however the process ends."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from mcap.writer import CompressionType, Writer

from lupin_runtime.graph import Qos

# A chunk is closed at this size, or earlier by `flush`.
CHUNK_BYTES = 1024 * 1024

_NEVER = "{sec: 9223372036, nsec: 854775807}"


class RecordingStopped(OSError):
    """Writing failed; the messages already in the file remain readable."""


class _Output:
    """An unbuffered file that is truncated to its last complete chunk when a write fails.

    A buffered file would keep the failed bytes and raise again while closing.
    """

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        # Exclusive creation: a restarted recorder must not overwrite a recording.
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        self._at = self._good = 0

    def write(self, data: bytes) -> int:
        view = memoryview(data)
        while view:
            try:
                written = os.write(self._descriptor, view)
            except OSError as error:
                os.ftruncate(self._descriptor, self._good)
                raise RecordingStopped(error.errno, error.strerror) from error
            self._at += written
            view = view[written:]
        return len(data)

    def tell(self) -> int:
        return self._at

    def flush(self) -> None:
        self._good = self._at

    def close(self) -> None:
        os.close(self._descriptor)


class RecordingWriter:
    """An MCAP file of profile `ros2`. Every method may raise RecordingStopped; after that call only `abandon`."""

    def __init__(self, path: Path) -> None:
        """Create the file. Raises FileExistsError, or RecordingStopped where it cannot be written."""
        self.path = path
        self._output = _Output(path)
        self._writer = Writer(self._output, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)  # type: ignore[arg-type]
        self._writer.start(profile="ros2", library="lupin")
        self._output.flush()
        self._schemas: dict[str, int] = {}
        self.messages = 0

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Add a metadata record of text values."""
        self._writer.add_metadata(name, dict(values))
        self._output.flush()

    def add_channel(self, topic: str, type_name: str, schema: str, qos: Qos) -> int:
        """Add a channel for messages of type `package/msg/Name` with the definition `schema`; returns its id."""
        if type_name not in self._schemas:
            self._schemas[type_name] = self._writer.register_schema(type_name, "ros2msg", schema.encode())
        return self._writer.register_channel(topic, "cdr", self._schemas[type_name], {"offered_qos_profiles": qos_yaml(qos)})

    def write(self, channel: int, data: bytes, log_ns: int, publish_ns: int, sequence: int = 0) -> None:
        """Add one serialized message."""
        self._writer.add_message(channel, log_ns, data, publish_ns, sequence)
        self.messages += 1

    def flush(self) -> None:
        """Close the chunk and pass it to the operating system, so that killing the process cannot lose it."""
        self._writer.flush()  # type: ignore[no-untyped-call]

    @property
    def size_bytes(self) -> int:
        """Bytes in the file so far."""
        return self._output.tell()

    def finish(self) -> None:
        """Write the index and close."""
        try:
            self._writer.finish()  # type: ignore[no-untyped-call]
            self._output.flush()
        finally:
            self._output.close()

    def abandon(self) -> None:
        """Close the file without an index, after a failed write."""
        self._output.close()


def free_name(path: Path) -> Path:
    """`path`, or the first of `<stem>-1.mcap`, `<stem>-2.mcap`, … that does not exist yet."""
    candidate, number = path, 0
    while candidate.exists():
        number += 1
        candidate = path.with_name(f"{path.stem}-{number}{path.suffix}")
    return candidate


def qos_yaml(qos: Qos) -> str:
    """A QoS in rosbag2's format for channels; its reader requires all of these keys."""
    return (
        f"- history: keep_last\n  depth: {qos.depth}\n"
        f"  reliability: {'reliable' if qos.reliable else 'best_effort'}\n"
        f"  durability: {'transient_local' if qos.latched else 'volatile'}\n"
        f"  deadline: {_NEVER}\n  lifespan: {_NEVER}\n"
        f"  liveliness: automatic\n  liveliness_lease_duration: {_NEVER}\n"
        "  avoid_ros_namespace_conventions: false\n"
    )
