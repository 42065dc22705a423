"""The image of a map file as GraphicsMagick, which Nav2's map_server reads with, gives it: 16 bits a channel, and alpha."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.bounded_file import read_bounded
from lupin_runtime.image_size import IMAGE_FORMATS, image_size

MAX_PIXELS = 25_000_000  # 250 m by 250 m at 5 cm; planning takes about 50 bytes for each
MAX_MAP_BYTES = 2 * MAX_PIXELS + 4096  # of the file: two bytes a pixel and a header
MAX_PLAIN_PIXELS = 4_000_000  # of a plain PGM (P2), whose numbers take 40 bytes each while they are read
WHITE = 65535
_MAX_DIGITS = 9
_CHANNELS = {b"P2": 1, b"P5": 1, b"P3": 3, b"P6": 3}
_PLAIN = (b"P2", b"P3")
_TEXT_HEADERS = (".pgm", ".ppm", ".pnm")
_PNG_GRAY = 0


@dataclass(frozen=True)
class MapImage:
    """`total` (height, width) is the sum of a pixel's `channels` (1 or 3), top row first; `alpha` is WHITE where opaque."""

    total: NDArray[np.integer]
    channels: int
    alpha: NDArray[np.uint16] | None = None


def read_map_image(path: Path) -> MapImage:
    """Read an image; its content decides on the format, not its name. Raises MalformedFile, OSError."""
    data = read_bounded(path, MAX_MAP_BYTES)
    return _read_netpbm(path, data) if data[:2] in _CHANNELS else _read_encoded(path, data)


def _check_size(path: Path, width: int, height: int, limit: int, line: int | None = None) -> None:
    if width * height > limit:
        problem = f"{width} x {height} pixels are more than the {limit} that a map may have; crop it, or use larger cells"
        raise MalformedFile(path, line, problem)


def _read_netpbm(path: Path, data: bytes) -> MapImage:
    """Read a PGM or PPM, binary or plain, of any white: OpenCV does not scale one other than 255."""
    magic = data[:2]
    numbers: list[int] = []
    at, line = 2, 1
    while len(numbers) < 3:
        while at < len(data) and (data[at : at + 1].isspace() or data[at : at + 1] == b"#"):
            if data[at : at + 1] == b"#":
                end = data.find(b"\n", at)
                at = len(data) if end < 0 else end
                continue
            line += data[at : at + 1] == b"\n"
            at += 1
        end = at
        while end < len(data) and data[end : end + 1].isdigit():
            end += 1
        if end == at:
            raise MalformedFile(path, line, f"expected width, height and white in the header, found {data[at : at + 8]!r}")
        if end - at > _MAX_DIGITS:
            raise MalformedFile(path, line, f"a number of {end - at} digits in the header")
        numbers.append(int(data[at:end]))
        at = end
    width, height, white = numbers
    if not (width > 0 and height > 0 and 0 < white < 65536):
        raise MalformedFile(path, line, f"{width} x {height} pixels with white {white} are not a map")
    channels = _CHANNELS[magic]
    _check_size(path, width, height, (MAX_PLAIN_PIXELS if magic in _PLAIN else MAX_PIXELS) // channels, line)
    count = width * height * channels
    if magic in _PLAIN:
        try:
            values = np.array(data[at:].split(maxsplit=count)[:count], dtype=np.uint64)
        except (ValueError, OverflowError):
            raise MalformedFile(path, line, f"a pixel is not a number from 0 to {white}") from None
    else:
        values = np.frombuffer(
            memoryview(data)[at + 1 :],
            dtype=np.uint8 if white < 256 else ">u2",
            count=min(count, max(0, len(data) - at - 1) // (1 if white < 256 else 2)),
        )
    if len(values) < count:
        found = len(values) // channels
        raise MalformedFile(path, None, f"expected {width * height} pixels, found {found}: the file is truncated")
    levels = ((WHITE * np.arange(white + 1, dtype=np.int64) + white // 2) // white).astype(np.uint16)
    pixels = levels[np.minimum(values, white).astype(np.uint16)].reshape(height, width, channels)
    return MapImage(pixels[:, :, 0] if channels == 1 else pixels.sum(axis=2, dtype=np.int32), channels)


def _read_encoded(path: Path, data: bytes) -> MapImage:
    import cv2

    if (size := image_size(data)) is None:
        line = 1 if path.suffix.lower() in _TEXT_HEADERS else None
        problem = f"expected {IMAGE_FORMATS}, found {data[:4]!r} or a damaged header; convert it: magick IN OUT.pgm"
        raise MalformedFile(path, line, problem)
    _check_size(path, *size, MAX_PIXELS)
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:  # more pixels than OpenCV takes
        raise MalformedFile(path, None, f"OpenCV refuses the image: {error}") from None
    if image is None or image.dtype not in (np.uint8, np.uint16):
        raise MalformedFile(path, None, f"expected an image, found {len(data)} bytes that OpenCV cannot read as gray or color")
    _check_size(path, image.shape[1], image.shape[0], MAX_PIXELS)
    scale = 257 if image.dtype == np.uint8 else 1
    if image.ndim == 2:
        gray = image.astype(np.uint16) * np.uint16(scale)
        transparent = _transparent_gray(data)
        return MapImage(gray, 1, None if transparent is None else np.where(gray == transparent, 0, WHITE).astype(np.uint16))
    alpha = image[:, :, 3].astype(np.uint16) * np.uint16(scale) if image.shape[2] == 4 else None
    return MapImage(image[:, :, :3].sum(axis=2, dtype=np.int32) * scale, 3, alpha)


def _transparent_gray(data: bytes) -> int | None:
    """Return the level that a gray PNG declares transparent (its chunk tRNS), which OpenCV ignores."""
    if not data.startswith(b"\x89PNG") or len(data) < 33 or data[25] != _PNG_GRAY:
        return None
    at = 8
    while at + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        if kind == b"tRNS" and length == 2:
            (value,) = struct.unpack_from(">H", data, at + 8)
            white = (1 << data[24]) - 1
            return int(value & white) * WHITE // white
        if kind == b"IDAT":
            return None
        at += 12 + length
    return None
