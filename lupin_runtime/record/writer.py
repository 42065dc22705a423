"""Writes one MCAP file so that whatever ends the process, what was written before reads back."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from mcap.writer import CompressionType, Writer

from lupin_runtime.graph import Qos

# A chunk closes when it is this big, or when `flush` is called, whichever comes first.
CHUNK_BYTES = 1024 * 1024

_NEVER = "{sec: 9223372036, nsec: 854775807}"


class RecordingStopped(OSError):
    """The file can't be written any further; what is in it stays and reads."""


class _Output:
    """An unbuffered file that is cut back to its last whole chunk when a write fails.

    A buffered one would keep the lost bytes and raise again while it closes.
    """

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        # Exclusive: a recording is never overwritten, whoever restarts the recorder.
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
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
    """An MCAP file of profile `ros2`. Every method may raise RecordingStopped; after that only `abandon` makes sense."""

    def __init__(self, path: Path) -> None:
        """Creates the file. Raises FileExistsError, or RecordingStopped where nothing can be written."""
        self.path = path
        self._output = _Output(path)
        self._writer = Writer(self._output, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)  # type: ignore[arg-type]
        self._writer.start(profile="ros2", library="lupin")
        self._output.flush()
        self._schemas: dict[str, int] = {}
        self.messages = 0

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Facts beside the messages, as text."""
        self._writer.add_metadata(name, dict(values))
        self._output.flush()

    def add_channel(self, topic: str, type_name: str, schema: str, qos: Qos) -> int:
        """The id of a new channel for messages of `package/msg/Name`, whose full definition is `schema`."""
        if type_name not in self._schemas:
            self._schemas[type_name] = self._writer.register_schema(type_name, "ros2msg", schema.encode())
        return self._writer.register_channel(topic, "cdr", self._schemas[type_name], {"offered_qos_profiles": qos_yaml(qos)})

    def write(self, channel: int, data: bytes, log_ns: int, publish_ns: int, sequence: int = 0) -> None:
        """Add one serialised message."""
        self._writer.add_message(channel, log_ns, data, publish_ns, sequence)
        self.messages += 1

    def flush(self) -> None:
        """Close the chunk and hand everything to the operating system, where a killed process can't lose it."""
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
        """Close a file that can't be finished."""
        self._output.close()


def free_name(path: Path) -> Path:
    """`path`, or the first of `<stem>-1.mcap`, `<stem>-2.mcap`, … that does not exist yet."""
    candidate, number = path, 0
    while candidate.exists():
        number += 1
        candidate = path.with_name(f"{path.stem}-{number}{path.suffix}")
    return candidate


def qos_yaml(qos: Qos) -> str:
    """A QoS in the form in which rosbag2 keeps it with a channel, all of whose keys its reader demands."""
    return (
        f"- history: keep_last\n  depth: {qos.depth}\n"
        f"  reliability: {'reliable' if qos.reliable else 'best_effort'}\n"
        f"  durability: {'transient_local' if qos.latched else 'volatile'}\n"
        f"  deadline: {_NEVER}\n  lifespan: {_NEVER}\n"
        f"  liveliness: automatic\n  liveliness_lease_duration: {_NEVER}\n"
        "  avoid_ros_namespace_conventions: false\n"
    )
