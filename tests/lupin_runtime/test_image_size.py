"""The size of an image is read from its header, before anything is decoded."""

from __future__ import annotations

import struct

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.image_size import image_size

_LOSSLESS = [cv2.IMWRITE_WEBP_QUALITY, 101]
_STARTS = (b"\x89PNG\r\n\x1a\n", b"\xff\xd8", b"BM", b"P5", b"II*\0", b"MM\0*\0\0\0\x08\0\x02", b"RIFF....WEBPVP8X", b"")


@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize(
    ("suffix", "options"),
    [(".png", []), (".jpg", []), (".bmp", []), (".tiff", []), (".webp", []), (".webp", _LOSSLESS)],
)
def test_size_is_that_of_the_decoded_image(suffix: str, options: list[int], channels: int) -> None:
    encoded = cv2.imencode(suffix, np.full((37, 53, channels), 90, np.uint8), options)[1].tobytes()
    assert image_size(encoded) == (53, 37)


def test_size_of_a_portable_map_and_of_a_big_endian_tiff() -> None:
    assert image_size(cv2.imencode(".pgm", np.zeros((37, 53), np.uint8))[1].tobytes()) == (53, 37)
    tags = struct.pack(">HHIHxxHHII", 256, 3, 1, 7_000, 257, 4, 1, 90_000)
    assert image_size(b"MM\0*" + struct.pack(">IH", 8, 2) + tags) == (7_000, 90_000)


def test_format_without_a_known_size_has_none() -> None:
    assert image_size(cv2.imencode(".jp2", np.zeros((37, 53), np.uint8))[1].tobytes()) is None


@given(start=st.sampled_from(_STARTS), rest=st.binary(max_size=60))
def test_damaged_header_is_no_error(start: bytes, rest: bytes) -> None:
    image_size(start + rest)
