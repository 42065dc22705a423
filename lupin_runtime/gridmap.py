"""An occupancy grid without ROS: the content of `/map`."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

UNKNOWN = -1
FREE = 0
OCCUPIED = 100


@dataclass(frozen=True)
class GridMap:
    """Occupancy of a rectangle of the map frame.

    `cells` is int8 of shape (height, width): -1 unknown, 0 free .. 100 occupied; row 0 is the lowest y.
    (`origin_x`, `origin_y`) is the outer corner of cell (0, 0), in meters.
    """

    cells: NDArray[np.int8]
    resolution_m: float
    origin_x: float
    origin_y: float

    def __post_init__(self) -> None:
        if self.cells.ndim != 2 or self.cells.dtype != np.int8:
            raise ValueError(f"cells must be int8 (height, width), not {self.cells.dtype} {self.cells.shape}")
        if not (self.resolution_m > 0.0 and math.isfinite(self.origin_x) and math.isfinite(self.origin_y)):
            raise ValueError(f"resolution {self.resolution_m} m, origin ({self.origin_x}, {self.origin_y}) are not a grid")

    @property
    def height(self) -> int:
        """Rows."""
        return int(self.cells.shape[0])

    @property
    def width(self) -> int:
        """Columns."""
        return int(self.cells.shape[1])

    def cell_of(self, x: float, y: float) -> tuple[int, int]:
        """Return (row, column) of the cell that contains a point; it may be outside the grid."""
        return (
            math.floor((y - self.origin_y) / self.resolution_m),
            math.floor((x - self.origin_x) / self.resolution_m),
        )

    def center_of(self, row: int, column: int) -> tuple[float, float]:
        """Return (x, y) of a cell's center."""
        return (
            self.origin_x + (column + 0.5) * self.resolution_m,
            self.origin_y + (row + 0.5) * self.resolution_m,
        )

    def contains(self, row: int, column: int) -> bool:
        """Return whether the grid has this cell."""
        return 0 <= row < self.height and 0 <= column < self.width
