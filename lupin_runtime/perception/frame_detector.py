"""Finds the tags in the frames of a camera within a time budget, with the help of the frame before.

The library's time grows with the pixels that have contrast. Where few do, full resolution is affordable. In front of leaves or
bricks it is not: the whole frame is searched at a lower resolution, and full resolution is left for the surroundings of the
tags of the last frame and for one part of the frame after the other.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import cv2
import numpy as np

from lupin_runtime.perception.tags import MIN_SIDE_PX, Found, Gray, TagDetection, TagEngine, accepted, check_gray, is_same_place

# At full resolution the library spends nine tenths of its time on quads of sensor noise. Smoothing the parts with less
# contrast than a tag has makes full resolution cheaper than half resolution was.
CONTRAST_WINDOW_PX = 5
CONTRAST_OVER_MEDIAN = 1.8  # the median is the noise, since most of an image has no edges
CONTRAST_LIMITS = (12.0, 40.0)
SMOOTHING_PX = 7

BUDGET_S = 0.011  # of 15 ms, since the corners of what is found last are refined after it
WHOLE_FRAME_SHARE = 0.75  # of the budget; the rest is for the corners and for full resolution in parts
DECIMATIONS = (1.0, 1.5, 2.0, 3.0)
# Seconds per pixel, and per pixel with contrast at full resolution: measured on one core of 2020, then corrected by each frame.
PIXEL_S, BUSY_PIXEL_S = 6e-9, 9e-8
CORRECTION_STEP, CORRECTION_LIMITS = 0.5, (0.1, 20.0)
MARGIN_TAGS, MARGIN_PX = 0.75, 12  # around a tag of the last frame
# The parts of a frame, columns and rows, and how far each reaches into the next: a tag that is larger is found without them.
PARTS, PART_OVERLAP_PX = (3, 2), 64


def smooth_low_contrast(gray: Gray) -> tuple[Gray, float]:
    """Smooth the parts with too little contrast for a tag; returns the image and the share of unchanged pixels."""
    kernel = np.ones((CONTRAST_WINDOW_PX, CONTRAST_WINDOW_PX), np.uint8)
    contrast = cv2.subtract(cv2.dilate(gray, kernel), cv2.erode(gray, kernel))
    threshold = float(np.clip(CONTRAST_OVER_MEDIAN * np.median(contrast[::4, ::4]), *CONTRAST_LIMITS))
    keep = cv2.threshold(contrast, threshold, 255, cv2.THRESH_BINARY)[1]
    smoothed = cv2.blur(gray, (SMOOTHING_PX, SMOOTHING_PX))
    cv2.copyTo(gray, keep, smoothed)
    return np.asarray(smoothed, np.uint8), cv2.countNonZero(keep) / keep.size


class FrameDetector:
    """Detects tags in one frame after the other. `clock` returns seconds; by default the CPU time of the calling thread."""

    def __init__(self, engine: TagEngine, budget_s: float = BUDGET_S, clock: Callable[[], float] = time.thread_time) -> None:
        self._engine, self._budget_s, self._clock = engine, budget_s, clock
        self._correction = 1.0  # measured time over predicted time
        self._last: list[TagDetection] = []
        self._next_part = 0

    def detect(self, gray: Gray) -> list[TagDetection]:
        """Detect the tags of a gray (height, width) uint8 image, in the order of `tags.detect`.

        Raises ValueError for an image of another shape or type.
        """
        check_gray(gray)
        if min(gray.shape) < MIN_SIDE_PX:
            return []
        deadline_s = self._clock() + self._budget_s
        gray = np.ascontiguousarray(gray)
        smoothed, busy_share = smooth_low_contrast(gray)
        decimation = self._decimation(gray.size, busy_share)
        found = self._find(smoothed if decimation == 1.0 else gray, busy_share, decimation)
        tags = accepted(gray, found)
        if decimation > 1.0:
            more = self._around_lost(gray, tags, deadline_s) + self._in_next_part(gray, busy_share, deadline_s)
            tags = accepted(gray, more, tags)
        self._last = tags
        return tags

    def _predicted_s(self, pixels: float, busy_share: float, decimation: float) -> float:
        return self._correction * pixels * (PIXEL_S + BUSY_PIXEL_S * busy_share / decimation**2)

    def _decimation(self, pixels: int, busy_share: float) -> float:
        """The finest resolution that leaves enough of the budget."""
        if len(self._engine.decimations) == 1:
            return self._engine.decimations[0]
        limit_s = WHOLE_FRAME_SHARE * self._budget_s
        return next((d for d in DECIMATIONS if self._predicted_s(pixels, busy_share, d) <= limit_s), DECIMATIONS[-1])

    def _find(self, gray: Gray, busy_share: float, decimation: float) -> list[Found]:
        """Search, and learn from the time that it took."""
        predicted_s, began_s = self._predicted_s(gray.size, busy_share, decimation), self._clock()
        found = list(self._engine.find(gray, decimation))
        ratio = (self._clock() - began_s) / predicted_s
        self._correction = float(np.clip(self._correction * ratio**CORRECTION_STEP, *CORRECTION_LIMITS)) if ratio > 0.0 else 1.0
        return found

    def _around_lost(self, gray: Gray, tags: Sequence[TagDetection], deadline_s: float) -> list[Found]:
        """Search at full resolution where the last frame had tags that this one seems to lack, while time is left."""
        more: list[Found] = []
        for lost in self._last:
            seen = any(tag.id == lost.id and is_same_place(tag.corners, lost.corners) for tag in tags)
            if seen or self._clock() >= deadline_s:
                continue
            margin = MARGIN_TAGS * np.ptp(lost.corners, axis=0) + MARGIN_PX
            low, high = lost.corners.min(axis=0) - margin, lost.corners.max(axis=0) + margin
            more += self._in_window(gray, *low.astype(int).tolist(), *high.astype(int).tolist())
        return more

    def _in_next_part(self, gray: Gray, busy_share: float, deadline_s: float) -> list[Found]:
        """Search the next part of the frame at full resolution, if there is time for it."""
        columns, rows = PARTS
        height, width = gray.shape
        row, column = divmod(self._next_part, columns)
        left, top = column * width // columns, row * height // rows
        right, bottom = (column + 1) * width // columns + PART_OVERLAP_PX, (row + 1) * height // rows + PART_OVERLAP_PX
        pixels = (right - left) * (bottom - top)
        if self._clock() + self._predicted_s(pixels, busy_share, 1.0) > deadline_s:
            return []
        self._next_part = (self._next_part + 1) % (columns * rows)
        return self._in_window(gray, left, top, right, bottom)

    def _in_window(self, gray: Gray, left: int, top: int, right: int, bottom: int) -> list[Found]:
        left, top = max(0, left), max(0, top)
        window = np.ascontiguousarray(gray[top:bottom, left:right])
        if min(window.shape) < MIN_SIDE_PX:
            return []
        return [
            (tag_id, corners + np.array([left, top]), hamming) for tag_id, corners, hamming in self._engine.find(window, 1.0)
        ]
