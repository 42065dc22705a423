"""Encodes raw images as JPEG, and changes the size or quality of compressed images, with OpenCV."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.cameras.image_message import RawImage

DEFAULT_QUALITY = 75
MAX_PIXELS = 40_000_000
_FARTHEST_M = 10.0  # in a depth image, this distance and unknown ones are black, and near ones white
_MILLIMETERS = 0.001

# The OpenCV conversion from each encoding to blue, green, red; None if its pixels are already in this order, or gray.
_CONVERSIONS: dict[str, str | None] = {
    "rgb8": "COLOR_RGB2BGR",
    "bgr8": None,
    "rgba8": "COLOR_RGBA2BGR",
    "bgra8": "COLOR_BGRA2BGR",
    "mono8": None,
    "8UC1": None,
    "8UC3": None,
    "yuv422": "COLOR_YUV2BGR_UYVY",
    "uyvy": "COLOR_YUV2BGR_UYVY",
    "yuv422_yuy2": "COLOR_YUV2BGR_YUY2",
    "yuyv": "COLOR_YUV2BGR_YUY2",
    # OpenCV names a Bayer pattern after the second row's second and third pixels, ROS after the first row's first two.
    "bayer_rggb8": "COLOR_BayerBG2BGR",
    "bayer_bggr8": "COLOR_BayerRG2BGR",
    "bayer_gbrg8": "COLOR_BayerGR2BGR",
    "bayer_grbg8": "COLOR_BayerGB2BGR",
}
_CHANNELS = {"rgb8": 3, "bgr8": 3, "8UC3": 3, "rgba8": 4, "bgra8": 4, "yuv422": 2, "uyvy": 2, "yuv422_yuy2": 2, "yuyv": 2}
_WIDE = {"mono16": np.uint16, "16UC1": np.uint16, "32FC1": np.float32}

Pixels = NDArray[Any]


class UnsupportedImage(ValueError):
    """An image that can't be shown; the text is the reason."""


def encode(image: RawImage, quality: int = DEFAULT_QUALITY, width_px: int = 0, rotated: bool = False) -> bytes:
    """Encode a raw image as JPEG: scaled to `width_px` unless that is 0, upside down if `rotated`.

    Raises UnsupportedImage.
    """
    if image.width * image.height > MAX_PIXELS:
        raise UnsupportedImage(f"{image.width} × {image.height} pixels are too many")
    return _to_jpeg(_colors(image), quality, width_px, rotated)


def transcode(jpeg: bytes | memoryview, quality: int = DEFAULT_QUALITY, width_px: int = 0, rotated: bool = False) -> bytes:
    """Encode a compressed image again as JPEG, with the parameters of `encode`. Raises UnsupportedImage."""
    cv2 = _opencv()
    try:
        pixels = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    except cv2.error as error:
        raise UnsupportedImage(f"the image can't be read: {error.err}") from error
    if pixels is None:
        raise UnsupportedImage("the image can't be read")
    return _to_jpeg(pixels, quality, width_px, rotated)


def is_jpeg(data: memoryview) -> bool:
    """Return whether data begins like a JPEG file."""
    return bytes(data[:3]) == b"\xff\xd8\xff"


def _colors(image: RawImage) -> Pixels:
    """Convert an image to blue, green and red, or gray: rows × columns × 3, or rows × columns, uint8."""
    if image.encoding in _WIDE:
        return _to_gray(image)
    if image.encoding not in _CONVERSIONS:
        known = ", ".join(sorted((*_CONVERSIONS, *_WIDE)))
        raise UnsupportedImage(f"images of encoding {image.encoding[:40]!r} are not supported; those are: {known}")
    channels = _CHANNELS.get(image.encoding, 1)
    pixels = _rows(image, np.dtype(np.uint8), channels)
    if channels == 1:
        pixels = pixels[:, :, 0]
    conversion = _CONVERSIONS[image.encoding]
    if conversion is None:
        return pixels
    cv2 = _opencv()
    if image.width < 2 or image.height < 2 or (channels == 2 and image.width % 2):
        raise UnsupportedImage(f"{image.width} × {image.height} pixels of encoding {image.encoding} can't be converted")
    converted: Pixels = cv2.cvtColor(np.ascontiguousarray(pixels), getattr(cv2, conversion))
    return converted


def _to_gray(image: RawImage) -> Pixels:
    """Convert a depth image, or a gray image of 16 bits, to 8 bits of gray."""
    kind = np.dtype(_WIDE[image.encoding]).newbyteorder(">" if image.big_endian else "<")
    values = _rows(image, kind, 1)[:, :, 0]
    if image.encoding == "mono16":
        return (values >> 8).astype(np.uint8)
    distances = values.astype(np.float32) * (_MILLIMETERS if kind.kind == "u" else 1.0)
    known = np.isfinite(distances) & (distances > 0)
    nearness = 1.0 - np.clip(np.where(known, distances, _FARTHEST_M) / _FARTHEST_M, 0.0, 1.0)
    return (nearness * 255).astype(np.uint8)


def _rows(image: RawImage, kind: np.dtype[Any], channels: int) -> Pixels:
    used_bytes = image.width * channels * kind.itemsize
    if used_bytes > image.row_bytes:
        raise UnsupportedImage(
            f"{image.width} pixels of encoding {image.encoding} need {used_bytes} bytes, not {image.row_bytes}"
        )
    rows = np.frombuffer(image.data, np.uint8)[: image.row_bytes * image.height].reshape(image.height, image.row_bytes)
    return np.ascontiguousarray(rows[:, :used_bytes]).view(kind).reshape(image.height, image.width, channels)


def _to_jpeg(pixels: Pixels, quality: int, width_px: int, rotated: bool) -> bytes:
    cv2 = _opencv()
    if width_px and width_px != pixels.shape[1]:
        height_px = max(1, round(pixels.shape[0] * width_px / pixels.shape[1]))
        if width_px * height_px > MAX_PIXELS:
            raise UnsupportedImage(f"{width_px} × {height_px} pixels are too many")
        smaller = width_px < pixels.shape[1]
        pixels = cv2.resize(pixels, (width_px, height_px), interpolation=cv2.INTER_AREA if smaller else cv2.INTER_LINEAR)
    if rotated:
        pixels = cv2.rotate(pixels, cv2.ROTATE_180)
    try:
        done, encoded = cv2.imencode(".jpg", pixels, (cv2.IMWRITE_JPEG_QUALITY, quality))
    except cv2.error as error:
        raise UnsupportedImage(f"the image can't be written as JPEG: {error.err}") from error
    if not done:
        raise UnsupportedImage("the image can't be written as JPEG")
    return bytes(encoded)


def _opencv() -> Any:
    """Import OpenCV only when it is needed: a robot whose cameras publish JPEG works without it."""
    try:
        import cv2
    except ImportError as error:
        raise UnsupportedImage("raw images need OpenCV; on the robot: sudo apt install python3-opencv") from error
    return cv2
