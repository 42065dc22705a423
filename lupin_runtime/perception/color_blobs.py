"""Flowers and bugs of the simulated greenhouse by color: bands of hue, saturation and value, then blobs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from lupin_runtime.perception.messages import FlowerDetection

CLASS_NAMES = ("tulip_red", "tulip_white", "tulip_pink", "bug")
WHITE_CLASS, BUG_CLASS = 1, 3

Band = tuple[tuple[int, int, int], tuple[int, int, int]]

# OpenCV's hue runs over 0-179; red and pink lie on both sides of its seam. Limits are inclusive.
BANDS: tuple[tuple[Band, ...], ...] = (
    (((150, 150, 70), (179, 255, 255)), ((0, 150, 70), (8, 255, 255))),
    (((0, 0, 140), (179, 38, 255)),),
    (((140, 40, 140), (179, 135, 255)), ((0, 40, 140), (14, 135, 255))),
    (((0, 0, 0), (179, 255, 50)),),
)

WORKING_WIDTH_PX = 320  # a flower half a meter away is 25 pixels wide even then, and a frame costs a quarter
MAX_AREA_SHARE = 0.15  # of the image; a larger blob is floor, wall or paper
MIN_PETAL_SHARE = 0.35  # of a flower's outline; a bug covers half of it at most
MIN_FILLING = 0.45  # of its own bounding box, which an ellipse fills to 0.79
MAX_ASPECT = 3.0
# The black of a printed tag, whose white modules look like small flowers: dark, and grayer than soil or a wall in the shade.
INK_VALUE, INK_SATURATION = 90, 40
MAX_INK_SHARE = 0.35  # of the rim of a white blob; a bug that sits on the petals covers less
RIM_PX = 4


@dataclass(frozen=True)
class BlobLimits:
    """What counts as a flower, in pixels of an image 640 wide."""

    min_area_px: float = 150.0
    conf_area_px: float = 2000.0
    morph_kernel_px: int = 5


def find_flowers(bgr: NDArray[np.uint8], limits: BlobLimits = BlobLimits()) -> list[FlowerDetection]:
    """Find every flower and bug of a BGR image (height, width, 3), class by class, the largest of each class first.

    Confidence is the area over `conf_area_px`, at most 1; a bug on a flower gets the flower's confidence, since its own area
    is part of the flower's. Floors, walls and the paper of a tag lie in white's band too, so blobs that are too
    large, too thin, hollow like the frame of a tag, or surrounded by ink like its modules are left out.
    """
    height, width = bgr.shape[:2]
    shrink = max(1.0, width / WORKING_WIDTH_PX)
    if shrink > 1.0:
        size = (WORKING_WIDTH_PX, max(1, round(height / shrink)))
        bgr = np.asarray(cv2.resize(bgr, size, interpolation=cv2.INTER_AREA), np.uint8)
    hsv = np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2HSV), np.uint8)
    # Areas are given for images 640 wide.
    px_area = (640.0 / bgr.shape[1]) ** 2
    kernel_px = max(1, round(limits.morph_kernel_px / px_area**0.5))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (kernel_px, kernel_px))

    def seen(class_id: int, mask: NDArray[np.uint8], petals: NDArray[np.uint8]) -> list[FlowerDetection]:
        opened = np.asarray(cv2.morphologyEx(mask, cv2.MORPH_OPEN, kernel), np.uint8)
        blobs = _blobs(opened, petals, hsv, class_id, limits.min_area_px / px_area)
        return [
            FlowerDetection(
                class_id,
                min(1.0, blob.area * px_area / limits.conf_area_px),
                (blob.x * shrink, blob.y * shrink, (blob.x + blob.w) * shrink, (blob.y + blob.h) * shrink),
            )
            for blob in sorted(blobs, key=lambda blob: -blob.area)
        ]

    dark = _mask(hsv, BUG_CLASS)
    bugs = seen(BUG_CLASS, dark, dark)
    on_petals = np.zeros_like(dark)
    for x1, y1, x2, y2 in (bug.box_px for bug in bugs if bug.confidence < 1.0):
        part = slice(int(y1 / shrink), int(y2 / shrink)), slice(int(x1 / shrink), int(x2 / shrink))
        on_petals[part] = dark[part]
    found: list[FlowerDetection] = []
    for class_id in range(BUG_CLASS):
        petals = _mask(hsv, class_id)
        if petals.any():
            # A bug hides a part of its flower, or splits it in two: its pixels count as part of the flower's outline.
            found += seen(class_id, petals | on_petals, petals)
    return found + [replace(bug, confidence=max(bug.confidence, _flower_confidence(bug, found))) for bug in bugs]


@dataclass(frozen=True)
class _Blob:
    """A rectangle in the working image and the pixels of the blob in it."""

    x: int
    y: int
    w: int
    h: int
    area: int


def _mask(hsv: NDArray[np.uint8], class_id: int) -> NDArray[np.uint8]:
    first, *others = BANDS[class_id]
    mask = cv2.inRange(hsv, *first)
    for band in others:
        mask |= cv2.inRange(hsv, *band)
    return np.asarray(mask, np.uint8)


def _flower_confidence(bug: FlowerDetection, flowers: list[FlowerDetection]) -> float:
    """The confidence of the flower under a bug, 0 for a bug that sits on none."""
    x, y = (bug.box_px[0] + bug.box_px[2]) / 2.0, (bug.box_px[1] + bug.box_px[3]) / 2.0
    under = (b.confidence for b in flowers if b.box_px[0] <= x <= b.box_px[2] and b.box_px[1] <= y <= b.box_px[3])
    return max(under, default=0.0)


def _blobs(
    mask: NDArray[np.uint8], petals: NDArray[np.uint8], hsv: NDArray[np.uint8], class_id: int, min_area: float
) -> list[_Blob]:
    """Connected parts of the mask that have a flower's size and shape, and enough of its own color."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    blobs = []
    for label, (x, y, w, h, area) in enumerate(stats[1:count].tolist(), start=1):
        flat = max(w, h) > MAX_ASPECT * min(w, h)
        if area < min_area or area > MAX_AREA_SHARE * mask.size or flat:
            continue
        part = slice(y, y + h), slice(x, x + w)
        blob = labels[part] == label
        colored = int(np.count_nonzero(petals[part][blob]))
        if colored < MIN_PETAL_SHARE * area or _filled_area(blob) < MIN_FILLING * w * h:
            continue
        if class_id != WHITE_CLASS or not _rim_is_ink(labels, label, hsv, x, y, w, h):
            blobs.append(_Blob(x, y, w, h, area))
    return blobs


def _filled_area(blob: NDArray[np.bool_]) -> float:
    """Pixels of a blob with its holes filled: a bug on the petals is one."""
    outlines, _ = cv2.findContours(np.asarray(blob, np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    filled = cv2.drawContours(np.zeros(blob.shape, np.uint8), outlines, -1, 1, cv2.FILLED)
    return float(cv2.countNonZero(filled))


def _rim_is_ink(labels: NDArray[Any], label: int, hsv: NDArray[Any], x: int, y: int, w: int, h: int) -> bool:
    """Whether the blob in that rectangle is bordered by black, as the white modules of a tag are."""
    part = slice(max(0, y - RIM_PX), y + h + RIM_PX), slice(max(0, x - RIM_PX), x + w + RIM_PX)
    blob = np.asarray(labels[part] == label, np.uint8)
    grown = cv2.dilate(blob, np.ones((2 * RIM_PX + 1, 2 * RIM_PX + 1), np.uint8))
    rim = (grown > 0) & (blob == 0)
    around = hsv[part][rim]
    ink = (around[:, 2] <= INK_VALUE) & (around[:, 1] <= INK_SATURATION)
    return bool(rim.any()) and float(np.mean(ink)) > MAX_INK_SHARE
