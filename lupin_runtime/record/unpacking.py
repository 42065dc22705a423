"""Unpacks what rosbag2 compresses: whole files, read forward without a copy on the disk, and single messages.

rosbag2's compression modes `file` and `message` use zstd (rosbag2_compression_zstd); files that `lz4` packed are read as well.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, Protocol, cast

import lz4.frame
import zstandard

from lupin_runtime.bounded_file import open_regular

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"  # RFC 8878, 3.1.1. A serialized message begins with 0: RTPS 2.2, 10.2.1.2
LZ4_MAGIC = b"\x04\x22\x4d\x18"
_WINDOW_BYTES = 128 << 20  # of zstd's memory: the default limit of the program `zstd`
_SKIP_BYTES = 1 << 20
_DAMAGE = (zstandard.ZstdError, RuntimeError, EOFError, OSError)  # of a packed file; liblz4's errors are a RuntimeError


class Stream(Protocol):
    """What is read of a file, packed or not."""

    def read(self, size: int, /) -> bytes:
        """Return `size` bytes, or fewer at the end."""

    def seek(self, offset: int, whence: int = io.SEEK_SET, /) -> int:
        """Go forward."""

    def tell(self) -> int:
        """Return the position."""


class _Unpacked:
    """The content of a packed file, forward only. It ends where the file is damaged."""

    def __init__(self, packed: BinaryIO) -> None:
        self._packed = packed
        self._at = 0

    def read(self, size: int, /) -> bytes:
        try:
            data = self._packed.read(size)
        except _DAMAGE:
            data = b""
        self._at += len(data)
        return data

    def seek(self, offset: int, whence: int = io.SEEK_SET, /) -> int:
        target = offset + (self._at if whence == io.SEEK_CUR else 0)
        while self._at < target and self.read(min(target - self._at, _SKIP_BYTES)):
            pass
        return self._at

    def tell(self) -> int:
        return self._at


def _open_zstd(file: BinaryIO) -> BinaryIO:
    return zstandard.ZstdDecompressor(max_window_size=_WINDOW_BYTES).stream_reader(file, read_across_frames=True)


def _open_lz4(file: BinaryIO) -> BinaryIO:
    return cast(BinaryIO, lz4.frame.LZ4FrameFile(file))


_OPENERS: dict[bytes, Callable[[BinaryIO], BinaryIO]] = {ZSTD_MAGIC: _open_zstd, LZ4_MAGIC: _open_lz4}


@contextmanager
def open_unpacked(path: Path) -> Iterator[tuple[Stream, int]]:
    """Open a file, packed or not; yield its content and size, `sys.maxsize` if it is packed. Raises OSError."""
    with open_regular(path) as file:
        opener = _OPENERS.get(file.read(4))
        file.seek(0)
        if opener is None:
            yield file, os.fstat(file.fileno()).st_size
        else:
            yield _Unpacked(opener(file)), sys.maxsize


def unpack_message(data: bytes, max_bytes: int) -> bytes | None:
    """Return a message as it was before rosbag2 compressed it; None if it cannot be unpacked or is larger than `max_bytes`."""
    if not data.startswith(ZSTD_MAGIC):
        return data
    try:
        # An unknown size is given as a huge one; rosbag2 always writes the size.
        return zstandard.decompress(data) if 0 <= zstandard.frame_content_size(data) <= max_bytes else None
    except zstandard.ZstdError:
        return None
