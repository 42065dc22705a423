"""The pictures of AprilTag's family 36h11, upright as the AprilTag project prints them.

OpenCV draws the same family turned by 180 degrees (seen in 4.x and 5.0; a later 5.x sets it right), so its pictures are
turned here by whatever makes id 0 agree with the official one.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

TAG_COUNT = 587
MODULES = 8  # across the black square, border included; the tag's edge length is measured over these

# The inner 6 x 6 modules of the official id 0, top row first, 1 = white.
ID0_ROWS = ("110101", "011101", "011000", "101000", "010110", "000100")


@lru_cache(maxsize=1)
def _family() -> tuple[cv2.aruco.Dictionary, int]:
    """OpenCV's dictionary and the quarter turns (counter-clockwise) that make its pictures official."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    official = np.array([[int(bit) for bit in row] for row in ID0_ROWS], np.uint8)
    drawn = _draw(dictionary, 0)[1:-1, 1:-1]
    for turns in range(4):
        if np.array_equal(np.rot90(drawn, turns), official):
            return dictionary, turns
    raise RuntimeError(f"OpenCV {cv2.__version__} draws an id 0 of tag36h11 that is not the family's, in no rotation")


def _draw(dictionary: cv2.aruco.Dictionary, tag_id: int) -> NDArray[np.uint8]:
    # OpenCV 4.6 has drawMarker only, 4.7 and later generateImageMarker only.
    draw = getattr(cv2.aruco, "generateImageMarker", None) or getattr(cv2.aruco, "drawMarker")  # noqa: B009 - not in stubs
    return np.asarray(draw(dictionary, tag_id, MODULES) > 127, np.uint8)


@lru_cache(maxsize=TAG_COUNT)
def modules(tag_id: int) -> NDArray[np.uint8]:
    """(8, 8) modules of the upright tag, top row first, 1 = white; the outermost ring is black. Read-only."""
    if not 0 <= tag_id < TAG_COUNT:
        raise ValueError(f"tag36h11 has the ids 0 to {TAG_COUNT - 1}, not {tag_id}")
    dictionary, turns = _family()
    picture = np.ascontiguousarray(np.rot90(_draw(dictionary, tag_id), turns))
    picture.setflags(write=False)
    return picture


def picture(tag_id: int, module_px: int, quiet_modules: int = 1) -> NDArray[np.uint8]:
    """The upright tag as a grey picture, (8 + 2 * quiet_modules) * module_px pixels square, with its white quiet zone."""
    with_quiet = np.pad(modules(tag_id), quiet_modules, constant_values=1)
    return np.kron(with_quiet * np.uint8(255), np.ones((module_px, module_px), np.uint8))
