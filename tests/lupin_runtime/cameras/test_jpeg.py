"""JPEG images of every encoding that cameras publish."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from lupin_runtime.cameras.image_message import RawImage, read_image
from lupin_runtime.cameras.jpeg import UnsupportedImage, encode, is_jpeg, transcode
from tests.support.image_messages import Pixels, decoded, gradient, image_message, jpeg

BGR = gradient()
HEIGHT, WIDTH, _ = BGR.shape
TOLERANCE = 12  # of 255; at this quality, JPEG changes a gradient by less


def raw(pixels: NDArray[Any], encoding: str, padding: int = 0, *, big_endian: bool = False) -> RawImage:
    """Return an image whose rows end with `padding` meaningless bytes."""
    rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(len(pixels), -1)
    rows = np.hstack([rows, np.full((len(rows), padding), 255, np.uint8)])
    height, width = pixels.shape[:2]
    return RawImage(1, width, height, encoding, big_endian, rows.shape[1], memoryview(rows.tobytes()))


def off_by(data: bytes, expected: Pixels) -> float:
    """Return the mean difference between a JPEG image and the expected pixels."""
    return float(np.abs(decoded(data) - expected.astype(np.int16)).mean())


@pytest.mark.parametrize("padding", [0, 5])
@pytest.mark.parametrize(
    ("encoding", "conversion"),
    [("rgb8", cv2.COLOR_BGR2RGB), ("bgr8", None), ("8UC3", None), ("rgba8", cv2.COLOR_BGR2RGBA), ("bgra8", cv2.COLOR_BGR2BGRA)],
)
def test_colors_are_kept(encoding: str, conversion: int | None, padding: int) -> None:
    pixels = BGR if conversion is None else cv2.cvtColor(BGR, conversion)
    assert off_by(encode(raw(np.asarray(pixels, np.uint8), encoding, padding)), BGR) < 3


@pytest.mark.parametrize(("encoding", "first"), [("yuv422", 1), ("uyvy", 1), ("yuv422_yuy2", 0), ("yuyv", 0)])
def test_luminance_and_color_of_yuv_are_distinguished(encoding: str, first: int) -> None:
    yuv = cv2.cvtColor(BGR, cv2.COLOR_BGR2YUV)
    packed = np.zeros((HEIGHT, WIDTH, 2), np.uint8)
    packed[:, :, first] = yuv[:, :, 0]
    packed[:, 0::2, 1 - first] = yuv[:, 0::2, 1]
    packed[:, 1::2, 1 - first] = yuv[:, 0::2, 2]
    assert off_by(encode(raw(packed, encoding)), BGR) < TOLERANCE


@pytest.mark.parametrize(("encoding", "red", "blue"), [
    ("bayer_rggb8", (0, 0), (1, 1)), ("bayer_bggr8", (1, 1), (0, 0)),
    ("bayer_gbrg8", (1, 0), (0, 1)), ("bayer_grbg8", (0, 1), (1, 0)),
])  # fmt: skip
def test_bayer_patterns_are_distinguished(encoding: str, red: tuple[int, int], blue: tuple[int, int]) -> None:
    mosaic = np.ascontiguousarray(BGR[:, :, 1])
    for (row, column), channel in ((red, 2), (blue, 0)):
        mosaic[row::2, column::2] = BGR[row::2, column::2, channel]
    inner = np.s_[4:-4, 4:-4]
    shown = decoded(encode(raw(mosaic, encoding)))
    assert np.abs(shown - BGR.astype(np.int16))[inner].mean() < TOLERANCE


def test_gray_images_stay_gray() -> None:
    gray = np.ascontiguousarray(BGR[:, :, 2])
    for pixels, encoding in ((gray, "mono8"), (gray, "8UC1"), (gray.astype(np.uint16) << 8, "mono16")):
        assert off_by(encode(raw(pixels, encoding)), np.repeat(gray[:, :, None], 3, 2)) < 3


@pytest.mark.parametrize("big_endian", [False, True])
def test_near_depth_is_white_and_unknown_depth_black(big_endian: bool) -> None:
    meters = np.full((32, 64), 9.0, np.float32)
    meters[:, :16], meters[:, 16:32], meters[:, 32:48] = 0.5, np.nan, np.inf
    millimeters = np.where(np.isfinite(meters), meters * 1000, 0).astype(np.uint16)
    order = ">" if big_endian else "<"
    for pixels, encoding in ((meters.astype(f"{order}f4"), "32FC1"), (millimeters.astype(f"{order}u2"), "16UC1")):
        shown = decoded(encode(raw(pixels, encoding, big_endian=big_endian)))[:, :, 0]
        assert shown[:, 4:12].min() > 230 and shown[:, 20:44].max() < 8 and 15 < shown[:, 52:60].mean() < 40


def test_width_quality_and_rotation_are_applied() -> None:
    image = raw(BGR, "bgr8")
    assert decoded(encode(image, width_px=32)).shape == (24, 32, 3)
    assert decoded(encode(image, width_px=200)).shape == (150, 200, 3)
    assert len(encode(image, quality=5)) < len(encode(image, quality=95))
    assert off_by(encode(image, rotated=True), BGR[::-1, ::-1]) < 3
    smaller = transcode(jpeg(BGR), width_px=32)
    assert decoded(smaller).shape == (24, 32, 3) and is_jpeg(memoryview(smaller))


@pytest.mark.parametrize(
    "image",
    [
        raw(BGR, "rgb32"),
        raw(BGR, ""),
        raw(BGR[:1, :1], "bayer_rggb8"),
        raw(BGR[:, :3, :2], "yuv422"),
        raw(BGR[:, :, 0], "rgb8"),  # rows that are too short
        RawImage(0, 10_000, 10_000, "mono8", False, 10_000, memoryview(b"")),
    ],
    ids=["unknown", "none", "one pixel of a pattern", "half a pair of pixels", "short rows", "huge"],
)
def test_images_that_cannot_be_shown_are_refused(image: RawImage) -> None:
    with pytest.raises(UnsupportedImage):
        encode(image)


@pytest.mark.parametrize("data", [b"", b"\xff\xd8\xff", b"not an image", bytes(1000)])
def test_damaged_images_are_refused(data: bytes) -> None:
    with pytest.raises(UnsupportedImage):
        transcode(data)


def test_image_message_is_encoded() -> None:
    message = image_message(BGR.tobytes(), WIDTH, HEIGHT, "bgr8", 3 * WIDTH, stamp_ns=7)
    assert off_by(encode(read_image(message)), BGR) < 3
