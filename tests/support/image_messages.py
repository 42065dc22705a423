"""Pictures as serialized messages, for tests of video."""

from __future__ import annotations

import struct

import cv2
import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[np.uint8]


def gradient(width: int = 64, height: int = 48) -> Pixels:
    """Return a BGR image: red grows to the right, blue grows downwards."""
    pixels = np.zeros((height, width, 3), np.uint8)
    pixels[:, :, 2] = np.linspace(0, 255, width, dtype=np.uint8)
    pixels[:, :, 0] = np.linspace(0, 255, height, dtype=np.uint8)[:, None]
    return pixels


def jpeg(pixels: Pixels) -> bytes:
    """Return the image as a JPEG file."""
    return bytes(cv2.imencode(".jpg", pixels)[1])


def decoded(data: bytes) -> NDArray[np.int16]:
    """Return the pixels of a JPEG file, as signed numbers that can be subtracted."""
    pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert pixels is not None
    return np.asarray(pixels, np.int16)


def image_message(
    data: bytes, width: int, height: int, encoding: str, row_bytes: int, *, stamp_ns: int = 0, frame: str = "camera"
) -> bytes:
    """Return a sensor_msgs/msg/Image in little-endian CDR."""
    out = _header(stamp_ns, frame)
    out += struct.pack("<II", height, width) + _string(encoding)
    out += b"\0"
    return _bytes(_aligned(out) + struct.pack("<I", row_bytes), data)


def compressed_message(data: bytes, form: str = "jpeg", *, stamp_ns: int = 0, frame: str = "camera") -> bytes:
    """Return a sensor_msgs/msg/CompressedImage in little-endian CDR."""
    return _bytes(_header(stamp_ns, frame) + _string(form), data)


def _header(stamp_ns: int, frame: str) -> bytes:
    out = b"\0\1\0\0" + struct.pack("<iI", stamp_ns // 1_000_000_000, stamp_ns % 1_000_000_000)
    return _aligned(out + _string(frame))


def _string(text: str) -> bytes:
    data = text.encode() + b"\0"
    return struct.pack("<I", len(data)) + data


def _bytes(out: bytes, data: bytes) -> bytes:
    return _aligned(out) + struct.pack("<I", len(data)) + data


def _aligned(out: bytes) -> bytes:
    return out + b"\0" * (-(len(out) - 4) % 4)
