"""Reads the size of an encoded image from its header, before it is decoded: a small file may unpack to gigabytes."""

from __future__ import annotations

import struct

MAX_IMAGE_PIXELS = 50_000_000  # of a picture: above the sensors of cameras and phones that people use here
_PNG = b"\x89PNG\r\n\x1a\n"
_START_OF_FRAME = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}  # the markers of JPEG that carry a size
IMAGE_FORMATS = "PNG, JPEG, BMP, PNM, TIFF or WebP"
_TIFF_ORDER = {b"II*\0": "<", b"MM\0*": ">"}
_TIFF_WIDTH, _TIFF_HEIGHT = 256, 257  # tags of the first directory
_TIFF_TYPES = {3: "H", 4: "I"}
_WITHOUT_LENGTH = {0x01, *range(0xD0, 0xD9)}


def image_size(data: bytes) -> tuple[int, int] | None:
    """Return width and height in pixels of one of IMAGE_FORMATS; None for others, and for a damaged header."""
    try:
        if data.startswith(_PNG):
            width, height = struct.unpack_from(">II", data, 16)
            return width, height
        if data.startswith(b"BM"):
            width, height = struct.unpack_from("<ii", data, 18)
            return abs(width), abs(height)
        if data[:1] == b"P" and data[1:2] in b"123456":
            words = [word for line in data[2:512].split(b"\n") for word in line.partition(b"#")[0].split()]
            return int(words[0]), int(words[1])
        if data[:4] in _TIFF_ORDER:
            return _tiff_size(data, _TIFF_ORDER[data[:4]])
        if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
            return _webp_size(data)
        return _jpeg_size(data) if data.startswith(b"\xff\xd8") else None
    except (struct.error, ValueError, LookupError):
        return None


def _jpeg_size(data: bytes) -> tuple[int, int] | None:
    at = 2
    while True:
        marker, length = struct.unpack_from(">xBH", data, at)
        if marker in _START_OF_FRAME:
            height, width = struct.unpack_from(">HH", data, at + 5)
            return width, height
        at += 1 if marker == 0xFF else 2 if marker in _WITHOUT_LENGTH else 2 + length


def _tiff_size(data: bytes, order: str) -> tuple[int, int]:
    (at,) = struct.unpack_from(f"{order}I", data, 4)
    (count,) = struct.unpack_from(f"{order}H", data, at)
    values: dict[int, int] = {}
    for entry in range(at + 2, at + 2 + 12 * count, 12):
        tag, kind = struct.unpack_from(f"{order}HH", data, entry)
        if tag in (_TIFF_WIDTH, _TIFF_HEIGHT):
            (values[tag],) = struct.unpack_from(order + _TIFF_TYPES[kind], data, entry + 8)
    return values[_TIFF_WIDTH], values[_TIFF_HEIGHT]


def _webp_size(data: bytes) -> tuple[int, int] | None:
    kind = data[12:16]
    if kind == b"VP8X":
        return int.from_bytes(data[24:27], "little") + 1, int.from_bytes(data[27:30], "little") + 1
    if kind == b"VP8L":
        (bits,) = struct.unpack_from("<I", data, 21)
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<HH", data, 26)
        return width & 0x3FFF, height & 0x3FFF
    return None
