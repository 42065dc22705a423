"""Decodes image messages of any usual encoding to numpy arrays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[np.uint8]


class ImageError(ValueError):
    """An image message that cannot be decoded; the message says what was found."""


@dataclass(frozen=True)
class _Encoding:
    """Bytes per pixel, and OpenCV's conversions; None if none is needed."""

    channels: int
    to_gray: int | None
    to_bgr: int | None


_ENCODINGS = {
    "mono8": _Encoding(1, None, cv2.COLOR_GRAY2BGR),
    "8UC1": _Encoding(1, None, cv2.COLOR_GRAY2BGR),
    "rgb8": _Encoding(3, cv2.COLOR_RGB2GRAY, cv2.COLOR_RGB2BGR),
    "bgr8": _Encoding(3, cv2.COLOR_BGR2GRAY, None),
    "8UC3": _Encoding(3, cv2.COLOR_BGR2GRAY, None),
    "rgba8": _Encoding(4, cv2.COLOR_RGBA2GRAY, cv2.COLOR_RGBA2BGR),
    "bgra8": _Encoding(4, cv2.COLOR_BGRA2GRAY, cv2.COLOR_BGRA2BGR),
    "yuv422_yuy2": _Encoding(2, cv2.COLOR_YUV2GRAY_YUY2, cv2.COLOR_YUV2BGR_YUY2),
    "yuyv": _Encoding(2, cv2.COLOR_YUV2GRAY_YUY2, cv2.COLOR_YUV2BGR_YUY2),
    "yuv422": _Encoding(2, cv2.COLOR_YUV2GRAY_UYVY, cv2.COLOR_YUV2BGR_UYVY),
}


def gray_pixels(message: Any) -> Pixels:
    """Decode a sensor_msgs Image or CompressedImage to gray (height, width). Raises ImageError."""
    if hasattr(message, "format"):
        return _decompress(message, cv2.IMREAD_GRAYSCALE)
    return _convert(message, lambda encoding: encoding.to_gray)


def bgr_pixels(message: Any) -> Pixels:
    """Decode a sensor_msgs Image or CompressedImage to BGR (height, width, 3). Raises ImageError."""
    if hasattr(message, "format"):
        return _decompress(message, cv2.IMREAD_COLOR)
    return _convert(message, lambda encoding: encoding.to_bgr)


def _convert(message: Any, conversion: Callable[[_Encoding], int | None]) -> Pixels:
    encoding = _ENCODINGS.get(message.encoding)
    if encoding is None:
        raise ImageError(f"image encoding {message.encoding!r} is not one of {', '.join(_ENCODINGS)}")
    height, width, step = int(message.height), int(message.width), int(message.step)
    row = width * encoding.channels
    step = step or row
    data = np.frombuffer(message.data, np.uint8)
    if height <= 0 or width <= 0 or step < row or data.size < step * height:
        raise ImageError(
            f"an image of {width} x {height} {message.encoding} with rows of {step} bytes needs {step * height} bytes, "
            f"not {data.size}"
        )
    pixels = data[: step * height].reshape(height, step)[:, :row]
    if encoding.channels > 1:
        pixels = pixels.reshape(height, width, encoding.channels)
    code = conversion(encoding)
    if code is None:
        return pixels
    try:
        return np.asarray(cv2.cvtColor(np.ascontiguousarray(pixels), code), np.uint8)
    except cv2.error as error:  # such as an odd width of an encoding that shares colors between two pixels
        raise ImageError(f"an image of {width} x {height} {message.encoding} cannot be converted: {error.err}") from error


def _decompress(message: Any, flags: int) -> Pixels:
    data = np.frombuffer(message.data, np.uint8)
    try:
        pixels = cv2.imdecode(data, flags) if data.size else None
    except cv2.error:
        pixels = None
    if pixels is None:
        raise ImageError(f"{data.size} bytes of {message.format!r} are not an image that OpenCV can decode")
    return np.asarray(pixels, np.uint8)
