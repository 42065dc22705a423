"""Images of the graph are decoded, or refused by the name of their encoding; what OpenCV refuses is no defect."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lupin_runtime.perception import images
from lupin_runtime.perception.images import ImageError, bgr_pixels, gray_pixels

# sensor_msgs/image_encodings.hpp: every name that a driver may give.
DEPTHS = ("8U", "8S", "16U", "16S", "32S", "32F", "64F")
ENCODINGS = (
    *("rgb8", "rgba8", "rgb16", "rgba16", "bgr8", "bgra8", "bgr16", "bgra16", "mono8", "mono16"),
    *(f"{depth}C{channels}" for depth in DEPTHS for channels in (1, 2, 3, 4)),
    *(f"bayer_{pattern}{bits}" for pattern in ("rggb", "bggr", "gbrg", "grbg") for bits in (8, 16)),
    *("uyvy", "yuv422", "yuyv", "yuv422_yuy2", "nv21", "nv24", ""),
)


def image(encoding: str, width: int, height: int) -> Any:
    data = np.zeros(width * height * 32, np.uint8).tobytes()
    return SimpleNamespace(encoding=encoding, width=width, height=height, step=0, data=data)


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize(("width", "height"), [(1, 1), (1, 4), (3, 2), (5, 5), (16, 12)])
def test_every_encoding_is_decoded_or_named(encoding: str, width: int, height: int) -> None:
    for decode in (gray_pixels, bgr_pixels):
        try:
            pixels = decode(image(encoding, width, height))
        except ImageError as error:
            assert repr(encoding) in str(error) or encoding in str(error)
            assert encoding not in images._ENCODINGS or (width % 2 and "yu" in encoding)
        else:
            assert pixels.shape[:2] == (height, width)


@pytest.mark.parametrize("data", [b"", b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n" + bytes(40), b"GIF89a" + bytes(20)])
def test_damaged_compressed_images_are_refused(data: bytes) -> None:
    with pytest.raises(ImageError, match="not an image that OpenCV can decode"):
        gray_pixels(SimpleNamespace(format="jpeg", data=data))
