"""Local maps, which scans are matched against: surfels and likelihood field of the keyframes around a pose."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.slam import kernels
from lupin_runtime.slam.scan import ScanPoints

Array = NDArray[np.floating]
Index = NDArray[np.int64]


class ScanPool:
    """The points of all keyframes in contiguous arrays, so that a kernel can address any keyframe by number."""

    def __init__(self) -> None:
        self.xy = np.empty((4096, 2))
        self.normal = np.empty((4096, 2))
        self.sigma = np.empty(4096)
        self.start = np.zeros(64, np.int64)
        self.count = np.zeros(64, np.int64)
        self.corners = np.zeros((64, 4, 2))  # of the box around each scan, in its own frame
        self.sensor: list[tuple[float, float]] = []
        self._points = 0

    def __len__(self) -> int:
        return len(self.sensor)

    def add(self, scan: ScanPoints) -> int:
        """Store a scan; returns its number."""
        number, end = len(self.sensor), self._points + len(scan)
        if end > len(self.xy):
            size = max(end, 2 * len(self.xy))
            self.xy, self.normal = (grow(block, size) for block in (self.xy, self.normal))
            self.sigma = grow(self.sigma, size)
        if number == len(self.start):
            self.start, self.count = grow(self.start, 2 * number), grow(self.count, 2 * number)
            self.corners = grow(self.corners, 2 * number)
        block = slice(self._points, end)
        self.xy[block], self.normal[block], self.sigma[block] = scan.xy, scan.normal, scan.sigma
        self.start[number], self.count[number] = self._points, len(scan)
        if len(scan):
            (x0, y0), (x1, y1) = scan.xy.min(axis=0), scan.xy.max(axis=0)
            self.corners[number] = (x0, y0), (x0, y1), (x1, y0), (x1, y1)
        self.sensor.append(scan.sensor)
        self._points = end
        return number

    def scan(self, number: int) -> ScanPoints:
        """Return a stored scan, as a view."""
        block = slice(int(self.start[number]), int(self.start[number] + self.count[number]))
        return ScanPoints(self.xy[block], self.normal[block], self.sigma[block], self.sensor[number])


def grow(block: NDArray[Any], size: int) -> NDArray[Any]:
    """Return a copy of `block` with `size` rows; the rows after the old ones are zero."""
    result = np.zeros((size, *block.shape[1:]), block.dtype)
    result[: len(block)] = block
    return result


@dataclass(frozen=True)
class FieldShape:
    """Resolution of local maps, their reach around their center, and the standard deviation of the likelihood, meters."""

    cell_m: float = 0.05
    reach_m: float = 14.0
    bell_m: float = 0.07
    levels: int = 6  # of the pyramid for wide searches: bounds over up to 2^5 cells


class LocalMap:
    """Surfels and field of chosen keyframes. Buffers are reused from build to build."""

    def __init__(self, shape: FieldShape | None = None) -> None:
        self.shape = shape or FieldShape()
        reach = math.ceil(2.5 * self.shape.bell_m / self.shape.cell_m)
        along = np.arange(-reach, reach + 1) * self.shape.cell_m
        squared = along[:, None] ** 2 + along[None, :] ** 2
        self._stamp = np.ascontiguousarray(np.rint(255 * np.exp(-squared / (2 * self.shape.bell_m**2))).astype(np.uint8))
        self.corner = (0.0, 0.0)
        self.size = (0, 0)
        self.slot = np.empty((0, 0, 2), np.int32)
        self.surfel = np.empty((0, 5))
        self.surfels = 0
        # Rasters are reused; only cells that the last build touched are cleared: clearing all would cost more than drawing.
        self._slots = np.empty(0, np.int32)
        self._marked = np.empty(0, np.uint8)
        self._marks = np.empty(0, np.int32)
        self._mark_count = 0
        self._pyramid = np.empty((0, 0, 0), np.uint8)
        self._levels_ready = 0

    @property
    def field(self) -> NDArray[np.uint8]:
        """The likelihood, 0 to 255 (height, width)."""
        level: NDArray[np.uint8] = self._pyramid[0]
        return level

    def build(self, pool: ScanPool, numbers: Index, poses: Array, center: tuple[float, float]) -> None:
        """Draw the scans `numbers` (k,) of the pool at `poses` (k, 3), without points beyond the reach of `center`."""
        shape = self.shape
        pad = (1 << (shape.levels - 1)) + self._stamp.shape[0]
        c, s = np.cos(poses[:, 2])[:, None], np.sin(poses[:, 2])[:, None]
        x, y = pool.corners[numbers, :, 0], pool.corners[numbers, :, 1]
        extents = np.stack((c * x - s * y + poses[:, :1], s * x + c * y + poses[:, 1:2]), axis=2).reshape(-1, 2)
        low = np.maximum(extents.min(axis=0), np.array(center) - shape.reach_m)
        high = np.minimum(extents.max(axis=0), np.array(center) + shape.reach_m)
        low = np.floor(low / shape.cell_m).astype(int) - pad
        high = np.ceil(np.maximum(high, low * shape.cell_m) / shape.cell_m).astype(int) + pad
        width, height = int(high[0] - low[0]), int(high[1] - low[1])
        self.corner = (float(low[0] * shape.cell_m), float(low[1] * shape.cell_m))
        self.size = (height, width)
        self._clean(width * height)
        self.slot = self._slots[: 2 * width * height].reshape(height, width, 2)
        self._pyramid = np.zeros((1, height, width), np.uint8)
        self._levels_ready = 1
        total = int(pool.count[numbers].sum())
        if len(self.surfel) < total:
            self.surfel = np.empty((2 * total, 5))
            self._marks = np.empty(2 * total, np.int32)
        self.surfels, marks = kernels.add_surfels(
            pool.xy, pool.normal, pool.start[numbers], pool.count[numbers], np.ascontiguousarray(poses), self.corner,
            shape.cell_m, self.size, self.slot, self.surfel, 0, self._marked, self._marks, 0,
        )  # fmt: skip
        self._mark_count = marks
        kernels.finish_surfels(self.surfel, self.surfels)
        kernels.draw_field(self._marks, marks, self._stamp, self._pyramid[0])

    def marked_points(self) -> Array:
        """The centers (n, 2) of the cells that hold points, in the frame of the map."""
        rows, columns = np.divmod(self._marks[: self._mark_count], self.size[1])
        middles: Array = np.stack((columns + 0.5, rows + 0.5), axis=1) * self.shape.cell_m + np.array(self.corner)
        return middles

    def _clean(self, area: int) -> None:
        if len(self._marked) < area:
            self._slots = np.full(2 * area, -1, np.int32)
            self._marked = np.zeros(area, np.uint8)
            return
        touched = self._marks[: self._mark_count]
        self._slots.reshape(-1, 2)[touched] = -1
        self._marked[touched] = 0

    def pyramid(self, levels: int) -> NDArray[np.uint8]:
        """The field and its max-pooled levels (levels, height, width)."""
        levels = min(levels, self.shape.levels)
        if levels > self._levels_ready:
            grown = np.empty((levels, *self.size), np.uint8)
            grown[0] = self._pyramid[0]
            kernels.build_pyramid(grown)
            self._pyramid, self._levels_ready = grown, levels
        return self._pyramid[:levels]
