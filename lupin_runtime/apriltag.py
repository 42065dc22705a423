"""Images of the AprilTag family 36h11, upright as the AprilTag project prints them.

OpenCV draws this family turned by 180 degrees (opencv issue 28823; seen in 4.x and 5.0), and a later 5.x corrects that. So
the turn is not derived from OpenCV's version: it is the one that makes OpenCV's id 0 equal the official id 0.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

FAMILY_SIZE = 587
MODULES = 8  # across the black square, border included; a tag's edge length is measured over these

# The inner 6 x 6 modules of the official id 0, top row first, 1 = white.
ID0_ROWS = ("110101", "011101", "011000", "101000", "010110", "000100")


@lru_cache(maxsize=1)
def _family() -> tuple[cv2.aruco.Dictionary, int]:
    """Return OpenCV's dictionary, and the number of counter-clockwise quarter turns that make its images upright."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    official = np.array([[int(bit) for bit in row] for row in ID0_ROWS], np.uint8)
    drawn = _draw(dictionary, 0)[1:-1, 1:-1]
    for turns in range(4):
        if np.array_equal(np.rot90(drawn, turns), official):
            return dictionary, turns
    raise RuntimeError(
        f"OpenCV {cv2.__version__} draws tag36h11 id 0 unlike the official image in every orientation; use another version"
    )


def _draw(dictionary: cv2.aruco.Dictionary, tag_id: int) -> NDArray[np.uint8]:
    # OpenCV 4.6 has drawMarker only, 4.7 and later generateImageMarker only.
    draw = getattr(cv2.aruco, "generateImageMarker", None) or getattr(cv2.aruco, "drawMarker")  # noqa: B009 - not in stubs
    return np.asarray(draw(dictionary, tag_id, MODULES) > 127, np.uint8)


@lru_cache(maxsize=FAMILY_SIZE)
def modules(tag_id: int) -> NDArray[np.uint8]:
    """Return the read-only (8, 8) modules of the upright tag, top row first, 1 = white; the outermost ring is black.

    Raises ValueError for an id outside the family.
    """
    if not 0 <= tag_id < FAMILY_SIZE:
        raise ValueError(f"tag36h11 has the ids 0 to {FAMILY_SIZE - 1}, not {tag_id}")
    dictionary, turns = _family()
    upright = np.ascontiguousarray(np.rot90(_draw(dictionary, tag_id), turns))
    upright.setflags(write=False)
    return upright


def tag_image(tag_id: int, module_px: int, quiet_modules: int = 1) -> NDArray[np.uint8]:
    """Draw the upright tag with its white quiet zone, in black (0) and white (255).

    The image is square, (8 + 2 * quiet_modules) * module_px pixels wide. Raises ValueError for an id outside the family.
    """
    with_quiet_zone = np.pad(modules(tag_id), quiet_modules, constant_values=1)
    return np.kron(with_quiet_zone * np.uint8(255), np.ones((module_px, module_px), np.uint8))
