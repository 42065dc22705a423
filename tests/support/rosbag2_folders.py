"""Writes rosbag2 folders as `ros2 bag record -s mcap` does: splits, metadata.yaml, and its two modes of compression."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import yaml
import zstandard
from mcap.writer import CompressionType, Writer

Message = tuple[str, str, int, bytes]  # topic, type, time in ns, serialized


def write_split(path: Path, messages: Iterable[Message], *, pack_messages: bool = False, pack_file: bool = False) -> Path:
    """Write one MCAP file by the `mcap` package; return its path, to which a packed file adds .zstd."""
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=4000, compression=CompressionType.ZSTD)
        writer.start("ros2")
        channels: dict[str, int] = {}
        for topic, kind, at_ns, data in messages:
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "cdr", writer.register_schema(kind, "ros2msg", b""))
            writer.add_message(channels[topic], at_ns, zstandard.compress(data) if pack_messages else data, at_ns)
        writer.finish()  # type: ignore[no-untyped-call]
    if not pack_file:
        return path
    packed = path.with_name(path.name + ".zstd")
    packed.write_bytes(zstandard.compress(path.read_bytes()))
    path.unlink()
    return packed


def write_metadata(folder: Path, names: Sequence[str], **changes: Any) -> None:
    """Write metadata.yaml as rosbag2 does, with changed or additional keys."""
    information = {
        "version": 9,
        "storage_identifier": "mcap",
        "relative_file_paths": list(names),
        "compression_format": "",
        "compression_mode": "",
        **changes,
    }
    (folder / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": information}))
