"""Flowers and bugs of the simulated greenhouse by colour: bands of hue, saturation and value, then blobs."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lupin_runtime.perception.messages import SeenBloom

CLASS_NAMES = ("tulip_red", "tulip_white", "tulip_pink", "bug")
BUG_CLASS = 3

Band = tuple[tuple[int, int, int], tuple[int, int, int]]

# OpenCV's hue runs over 0-179; red and pink lie on both sides of its seam. Limits are inclusive.
BANDS: tuple[tuple[Band, ...], ...] = (
    (((150, 150, 70), (179, 255, 255)), ((0, 150, 70), (8, 255, 255))),
    (((0, 0, 140), (179, 38, 255)),),
    (((140, 40, 140), (179, 135, 255)), ((0, 40, 140), (14, 135, 255))),
    (((0, 0, 0), (179, 255, 50)),),
)

WORKING_WIDTH_PX = 320  # a bloom half a metre away is 25 pixels wide even then, and a frame costs a quarter
MAX_AREA_SHARE = 0.15  # of the picture: a larger blob is floor, wall or paper
MIN_FILLING = 0.45  # of its own bounding box, which an ellipse fills to 0.79
MAX_ASPECT = 3.0


@dataclass(frozen=True)
class BlobLimits:
    """What counts as a bloom, in pixels of a picture 640 wide."""

    min_area_px: float = 150.0
    conf_area_px: float = 2000.0
    morph_kernel_px: int = 5


def find_blooms(bgr: NDArray[np.uint8], limits: BlobLimits = BlobLimits()) -> list[SeenBloom]:
    """Every bloom and bug of a picture (height, width, 3), class by class, the largest of each class first.

    Confidence is the area over `conf_area_px`, at most 1. White is the trap: floors, walls and the paper of a tag lie in its
    band, so blobs that are too large, too thin, or hollow like the frame of a tag are left out.
    """
    height, width = bgr.shape[:2]
    shrink = max(1.0, width / WORKING_WIDTH_PX)
    if shrink > 1.0:
        size = (WORKING_WIDTH_PX, max(1, round(height / shrink)))
        bgr = np.asarray(cv2.resize(bgr, size, interpolation=cv2.INTER_AREA), np.uint8)
    # Areas are given for pictures 640 wide.
    px_area = (640.0 / bgr.shape[1]) ** 2
    hsv = cv2.cvtColor(bgr, cv2.COLOR_BGR2HSV)
    kernel_px = max(1, round(limits.morph_kernel_px / px_area**0.5))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (kernel_px, kernel_px))
    found: list[SeenBloom] = []
    for class_id, bands in enumerate(BANDS):
        mask = cv2.inRange(hsv, *bands[0])
        for band in bands[1:]:
            mask |= cv2.inRange(hsv, *band)
        if not mask.any():
            continue
        if kernel_px > 1:
            mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, kernel)
        found += _blobs(mask, class_id, limits, px_area, shrink)
    return found


def _blobs(mask: NDArray[np.uint8], class_id: int, limits: BlobLimits, px_area: float, shrink: float) -> list[SeenBloom]:
    count, _, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    blobs = []
    for x, y, w, h, area in stats[1:count].tolist():
        area_px = area * px_area
        flat = max(w, h) > MAX_ASPECT * min(w, h)
        if area_px < limits.min_area_px or area > MAX_AREA_SHARE * mask.size or area < MIN_FILLING * w * h or flat:
            continue
        box = (x * shrink, y * shrink, (x + w) * shrink, (y + h) * shrink)
        blobs.append(SeenBloom(class_id, min(1.0, area_px / limits.conf_area_px), box))
    return sorted(blobs, key=lambda blob: -(blob.box_px[2] - blob.box_px[0]) * (blob.box_px[3] - blob.box_px[1]))
