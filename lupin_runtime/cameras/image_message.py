"""Reads serialized messages of `sensor_msgs/msg/Image` and `CompressedImage` without copying their pixels.

The encoding is OMG's CDR, version 1: a header of four bytes, then values aligned to their size, relative to the header's end.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

_CDR_HEADER_BYTES = 4


class MalformedImage(ValueError):
    """A message whose fields contradict its size."""


@dataclass(frozen=True)
class RawImage:
    """Pixels, row by row: `height` rows of `row_bytes` bytes, each beginning with `width` pixels."""

    stamp_ns: int
    width: int
    height: int
    encoding: str  # as in sensor_msgs/image_encodings.hpp, such as rgb8
    big_endian: bool
    row_bytes: int
    data: memoryview


@dataclass(frozen=True)
class EncodedImage:
    """A compressed image, such as a JPEG file. `format` is free text, which usually names the codec."""

    stamp_ns: int
    format: str
    data: memoryview


def read_image(message: bytes) -> RawImage:
    """Read the fields of an Image. Raises MalformedImage."""
    reader = _Reader(message)
    stamp_ns = reader.header_stamp_ns()
    height, width = reader.uint32(), reader.uint32()
    encoding = reader.string()
    big_endian = reader.uint8() != 0
    row_bytes = reader.uint32()
    data = reader.sequence()
    if not width or not height or row_bytes * height > len(data):
        raise MalformedImage(f"{width} × {height} pixels in rows of {row_bytes} bytes do not fit into {len(data)} bytes")
    return RawImage(stamp_ns, width, height, encoding, big_endian, row_bytes, data)


def read_compressed(message: bytes) -> EncodedImage:
    """Read the fields of a CompressedImage. Raises MalformedImage."""
    reader = _Reader(message)
    return EncodedImage(reader.header_stamp_ns(), reader.string(), reader.sequence())


class _Reader:
    def __init__(self, message: bytes) -> None:
        if len(message) < _CDR_HEADER_BYTES:
            raise MalformedImage(f"a message has at least {_CDR_HEADER_BYTES} bytes, this one {len(message)}")
        self._order = "<" if message[1] & 1 else ">"
        self._data = memoryview(message)[_CDR_HEADER_BYTES:]
        self._at = 0

    def header_stamp_ns(self) -> int:
        """Read a std_msgs/Header and return its stamp; its frame is ignored."""
        seconds, nanoseconds = self._number("i", 4), self._number("I", 4)
        self.string()
        return seconds * 1_000_000_000 + nanoseconds

    def uint8(self) -> int:
        return self._number("B", 1)

    def uint32(self) -> int:
        return self._number("I", 4)

    def string(self) -> str:
        return bytes(self.sequence()).rstrip(b"\0").decode(errors="replace")

    def sequence(self) -> memoryview:
        length = self.uint32()
        begin, self._at = self._at, self._at + length
        if self._at > len(self._data):
            raise MalformedImage(f"{length} bytes are announced, but only {len(self._data) - begin} follow")
        return self._data[begin : self._at]

    def _number(self, kind: str, size: int) -> int:
        begin = -(-self._at // size) * size
        self._at = begin + size
        if self._at > len(self._data):
            raise MalformedImage(f"the message ends too early, after {len(self._data) + _CDR_HEADER_BYTES} bytes")
        (value,) = struct.unpack_from(self._order + kind, self._data, begin)
        return int(value)
