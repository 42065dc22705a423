"""Distances to obstacles on a grid map, and lines of sight between its points."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lupin_runtime.gridmap import GridMap


@dataclass(frozen=True)
class ClearanceMap:
    """`distance_m` (height, width) from each cell to the nearest obstacle; `free` (height, width): cells known to be free."""

    grid: GridMap
    distance_m: NDArray[np.float32]
    free: NDArray[np.bool_]

    @staticmethod
    def from_grid(grid: GridMap, free_thresh: int = 20, occupied_thresh: int = 65) -> ClearanceMap:
        """Compute the distances of a map. Thresholds are occupancies 0..100."""
        clear = (grid.cells < occupied_thresh).astype(np.uint8)
        distance = cv2.distanceTransform(clear, cv2.DIST_L2, 5) * grid.resolution_m
        return ClearanceMap(grid, distance.astype(np.float32), (grid.cells >= 0) & (grid.cells <= free_thresh))

    def distance_at(self, x: float, y: float) -> float:
        """Return the distance to the nearest obstacle in meters; 0 for a point that is not known to be free."""
        row, column = self.grid.cell_of(x, y)
        if not self.grid.contains(row, column) or not self.free[row, column]:
            return 0.0
        return float(self.distance_m[row, column])

    def has_line_of_sight(self, x: float, y: float, to_x: float, to_y: float, margin_m: float) -> bool:
        """Return whether no obstacle is on the line between two points, except on its last `margin_m`."""
        length = math.hypot(to_x - x, to_y - y) - margin_m
        if length <= 0.0:
            return True
        steps = max(2, math.ceil(2.0 * length / self.grid.resolution_m))
        f = np.linspace(0.0, length / (length + margin_m), steps)
        rows = np.floor((y + f * (to_y - y) - self.grid.origin_y) / self.grid.resolution_m).astype(int)
        columns = np.floor((x + f * (to_x - x) - self.grid.origin_x) / self.grid.resolution_m).astype(int)
        in_grid = (rows >= 0) & (rows < self.grid.height) & (columns >= 0) & (columns < self.grid.width)
        return bool(np.all(self.distance_m[rows[in_grid], columns[in_grid]] > 0.0))
