"""Lidar scans as ranges, and the evidence of obstacles that they leave in a grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2
from lupin_runtime.navigation.costmap import kernels


@dataclass(frozen=True)
class RangeScan:
    """Ranges (m, float32, one per beam); beam i looks along `angle_min_rad + i * angle_increment_rad` of the laser frame.

    `stamp_ns` is the time of the first beam, `duration_s` the time from the first to the last beam.
    """

    ranges_m: NDArray[np.float32]
    angle_min_rad: float
    angle_increment_rad: float
    range_min_m: float = 0.0
    range_max_m: float = float("inf")
    stamp_ns: int = 0
    duration_s: float = 0.0


@dataclass(frozen=True)
class BeamPoses:
    """The poses of the laser in the grid's frame, at the first and at the last beam."""

    first: Pose2
    last: Pose2


@dataclass(frozen=True)
class ScanLimits:
    """Ranges at which beams mark and clear. A return nearer than `nearest_m` is ignored: it may be the robot itself."""

    mark_max_m: float
    clear_max_m: float
    nearest_m: float = 0.25


class ObstacleLayer:
    """Evidence of obstacles in a grid: one hit marks a cell, `misses_to_clear` scans with beams through it clear it.

    Nav2 clears with a single ray, so a noisy beam that grazes a wall opens holes in it. Here a cell is cleared by several
    consecutive scans whose beams cross it while none hits it.
    """

    HIT = 240

    def __init__(self, height: int, width: int, misses_to_clear: int = 3) -> None:
        self.evidence: NDArray[np.uint8] = np.zeros((height, width), np.uint8)
        self._touched: NDArray[np.uint8] = np.zeros((height, width), np.uint8)
        self._miss = -(-self.HIT // misses_to_clear)

    def observe(self, scan: RangeScan, poses: BeamPoses, limits: ScanLimits, geometry: NDArray[np.float64]) -> int:
        """Mark and clear with a scan; return the number of usable beams. `geometry` is origin x, y and resolution, meters."""
        if not np.isfinite([scan.angle_min_rad, scan.angle_increment_rad]).all():
            return 0
        ranges = scan.ranges_m
        if scan.range_max_m < np.inf:
            ranges = np.where(ranges <= scan.range_max_m, ranges, np.float32(np.nan))
        ranges = np.ascontiguousarray(ranges, np.float32)
        height, width = self.evidence.shape
        first, last = poses.first, poses.last
        return int(
            kernels.trace_scan(
                *(self.evidence, self._touched, height, width, geometry),
                *(ranges, len(ranges), scan.angle_min_rad, scan.angle_increment_rad),
                np.array([first.x, first.y, first.yaw, last.x, last.y, last.yaw]),
                np.array([max(limits.nearest_m, scan.range_min_m), limits.mark_max_m, limits.clear_max_m]),
                *(self.HIT, self._miss),
            )
        )

    def age(self, amount: int) -> None:
        """Reduce all evidence: without a new hit a cell is cleared after HIT / amount calls."""
        np.subtract(self.evidence, np.minimum(self.evidence, np.uint8(amount)), out=self.evidence)

    def clear(self) -> None:
        """Clear all evidence."""
        self.evidence[:] = 0

    def clear_disc(self, row: float, column: float, radius_cells: float) -> None:
        """Clear the cells in a disc: under the robot there can be no obstacle."""
        height, width = self.evidence.shape
        low_r, high_r = max(0, int(row - radius_cells)), min(height, int(row + radius_cells) + 1)
        low_c, high_c = max(0, int(column - radius_cells)), min(width, int(column + radius_cells) + 1)
        if low_r >= high_r or low_c >= high_c:
            return
        rows = np.arange(low_r, high_r)[:, None] + 0.5 - row
        columns = np.arange(low_c, high_c)[None, :] + 0.5 - column
        window = self.evidence[low_r:high_r, low_c:high_c]
        window[rows * rows + columns * columns < radius_cells * radius_cells] = 0

    def shift(self, rows: int, columns: int) -> None:
        """Move the window over the world by whole cells; new cells have no evidence."""
        self.evidence = shift_grid(self.evidence, rows, columns, self.evidence.shape)

    def reshape(self, rows: int, columns: int, shape: tuple[int, int]) -> None:
        """Change the window to `shape`; its first cell is (rows, columns) of the present one."""
        self.evidence = shift_grid(self.evidence, rows, columns, shape)
        self._touched = np.zeros(shape, np.uint8)


def shift_grid(grid: NDArray[np.uint8], rows: int, columns: int, shape: tuple[int, int]) -> NDArray[np.uint8]:
    """Copy `grid[rows:, columns:]` into a zeroed window of `shape`; the offsets may be negative."""
    out = np.zeros(shape, np.uint8)
    height, width = grid.shape
    low_r, high_r = max(0, rows), min(height, rows + shape[0])
    low_c, high_c = max(0, columns), min(width, columns + shape[1])
    if low_r < high_r and low_c < high_c:
        out[low_r - rows : high_r - rows, low_c - columns : high_c - columns] = grid[low_r:high_r, low_c:high_c]
    return out
