"""AprilTags of family 36h11 as pictures, upright as the official prints are.

OpenCV draws this family turned by 180 degrees against the official images (opencv issue 28823), and a later version will
flip back, so the turn is decided by looking at the known bits of tag 0 instead of trusting a version.
"""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from lupin_sim.tag_family import FAMILY_SIZE

# The inner 6x6 modules of the official image of tag 0; 1 is white.
OFFICIAL_ID_0 = ("110101", "011101", "011000", "101000", "010110", "000100")
MODULES = 10  # white margin, black border, 6 data modules, black border, white margin


# Ink and paper as a camera sees them: printer's black is far from 0, and office paper is a little warm. It also keeps a
# plate far behind a bench out of the detector's bands for black bugs and white blooms.
INK_BGR = (72, 68, 66)
PAPER_BGR = (190, 226, 236)


def modules(tag_id: int) -> NDArray[np.bool_]:
    """The tag as shape (10, 10), True is white, row 0 at the top. Raises ValueError for an id outside the family."""
    if not 0 <= tag_id < FAMILY_SIZE:
        raise ValueError(f"tag {tag_id} is not in family 36h11, whose ids are 0 to {FAMILY_SIZE - 1}")
    return np.pad(np.rot90(_drawn(tag_id), _quarter_turns()), 1, constant_values=True)


def picture(tag_id: int, module_px: int = 20) -> NDArray[np.uint8]:
    """The plate as a BGR image of shape (10 * module_px, 10 * module_px, 3)."""
    white = np.kron(modules(tag_id), np.ones((module_px, module_px), bool))
    return np.where(white[..., None], PAPER_BGR, INK_BGR).astype(np.uint8)


def _drawn(tag_id: int) -> NDArray[np.bool_]:
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    return np.asarray(cv2.aruco.generateImageMarker(family, tag_id, 8)) > 127


@cache
def _quarter_turns() -> int:
    official = np.array([[bit == "1" for bit in row] for row in OFFICIAL_ID_0])
    for turns in range(4):
        if np.array_equal(np.rot90(_drawn(0), turns)[1:-1, 1:-1], official):
            return turns
    raise RuntimeError("this OpenCV draws tag36h11 id 0 unlike the official image in every orientation; use another version")
