"""Draws detected tags on a copy of their image."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from lupin_runtime.perception.tags import TagDetection

OUTLINE_BGR, FIRST_CORNER_BGR, LABEL_BGR = (60, 200, 60), (40, 40, 230), (40, 40, 230)
SUBPIXEL_BITS = 4


def draw_tags(bgr: NDArray[np.uint8], tags: Sequence[TagDetection]) -> NDArray[np.uint8]:
    """Return a copy of the image (height, width, 3) with the outline, the top left corner and the id of each tag."""
    shown = np.ascontiguousarray(bgr).copy()
    thickness = max(1, shown.shape[1] // 640)
    for tag in tags:
        outline = np.round(tag.corners * (1 << SUBPIXEL_BITS)).astype(np.int32)
        cv2.polylines(shown, [outline], True, OUTLINE_BGR, thickness, cv2.LINE_AA, SUBPIXEL_BITS)
        cv2.circle(
            shown,
            tuple(outline[0].tolist()),
            (3 * thickness) << SUBPIXEL_BITS,
            FIRST_CORNER_BGR,
            -1,
            cv2.LINE_AA,
            SUBPIXEL_BITS,
        )
        at = tuple(np.round(tag.corners.mean(axis=0)).astype(int).tolist())
        cv2.putText(shown, str(tag.id), at, cv2.FONT_HERSHEY_SIMPLEX, 0.6 * thickness, LABEL_BGR, 2 * thickness, cv2.LINE_AA)
    return shown
