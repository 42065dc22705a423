"""An occupancy grid of keyframe scans: counts per cell how many beams met it, and how many of them ended in it.

A counting model (Haehnel et al., IROS 2003). Counters commute, so a moved scan is removed at its old pose and added at its
new one; after a closure this is done a few scans at a time, and the map is never rebuilt as a whole.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.gridmap import UNKNOWN, GridMap
from lupin_runtime.slam import kernels
from lupin_runtime.slam.scan import ScanPoints

Array = NDArray[np.floating]

# Of a grid, 8 bytes each and twice that while it grows: 300 m by 300 m at 5 cm. Beyond it a pose is wrong.
MAX_CELLS = 36_000_000


@dataclass(frozen=True)
class OccupancySettings:
    """Cell size; beams that must meet a cell before it is known; share of them that must end in an occupied cell.

    The grid grows by `margin_m`; scans that moved less than `moved_m` and `moved_rad` are not drawn again.
    """

    resolution_m: float = 0.05
    min_beams: int = 2
    occupied_share: float = 0.25
    margin_m: float = 4.0
    moved_m: float = 0.01
    moved_rad: float = 0.002


@dataclass
class _Drawn:
    scan: ScanPoints
    pose: Array


class OccupancyMap:
    """A grid that grows with the scans drawn into it. Each scan has a key and is drawn once."""

    def __init__(self, settings: OccupancySettings | None = None) -> None:
        self.settings = settings or OccupancySettings()
        self._seen = np.zeros((0, 0), np.int32)
        self._hit = np.zeros((0, 0), np.int32)
        self._low = (0, 0)  # of cell (0, 0), in cells from the frame's origin: (column, row)
        self._drawn: dict[int, _Drawn] = {}
        self._waiting: dict[int, Array] = {}
        self.left_out = 0  # scans that were not drawn, because the grid would have got more than MAX_CELLS

    def __len__(self) -> int:
        return len(self._drawn)

    @property
    def waiting(self) -> int:
        """The number of scans that are still drawn at an outdated pose."""
        return len(self._waiting)

    def draw(self, key: int, scan: ScanPoints, pose: Array) -> None:
        """Draw a scan at a pose (3,), in place of the one that had this key. One that is too far away is left out."""
        self._waiting.pop(key, None)
        if key in self._drawn:
            self._count(self._drawn.pop(key), -1)
        drawn = _Drawn(scan, pose.copy())
        if not self._grow_to(scan, pose):
            self.left_out += 1
            return
        self._count(drawn, 1)
        self._drawn[key] = drawn

    def move(self, poses: dict[int, Array]) -> None:
        """Note the new poses of scans; `work` moves them."""
        s = self.settings
        for key, pose in poses.items():
            if key not in self._drawn:
                continue  # left out
            at = self._drawn[key].pose
            turn = abs((pose[2] - at[2] + math.pi) % (2 * math.pi) - math.pi)
            if abs(pose[0] - at[0]) + abs(pose[1] - at[1]) > s.moved_m or turn > s.moved_rad:
                self._waiting[key] = pose.copy()
            else:
                self._waiting.pop(key, None)

    def work(self, limit: int) -> None:
        """Move up to `limit` of the waiting scans."""
        for key in list(self._waiting)[:limit]:
            self.draw(key, self._drawn[key].scan, self._waiting[key])

    def grid(self) -> GridMap | None:
        """The known part of the map; None before the first scan. Its corner is a whole number of cells from the origin."""
        if not self._drawn:
            return None
        s = self.settings
        cells = kernels.grade_cells(self._seen, self._hit, s.min_beams, s.occupied_share)
        known = cells != UNKNOWN
        rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
        if not len(rows):
            return None
        return GridMap(
            np.ascontiguousarray(cells[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]),
            s.resolution_m,
            (self._low[0] + int(columns[0])) * s.resolution_m,
            (self._low[1] + int(rows[0])) * s.resolution_m,
        )

    def _count(self, drawn: _Drawn, sign: int) -> None:
        kernels.count_beams(
            self._seen, self._hit, self._low, self.settings.resolution_m, drawn.scan.xy, drawn.pose, drawn.scan.sensor, sign
        )

    def _grow_to(self, scan: ScanPoints, pose: Array) -> bool:
        """Make room for a scan at a pose; return False, and change nothing, if that takes more than MAX_CELLS."""
        cell = self.settings.resolution_m
        c, s = math.cos(pose[2]), math.sin(pose[2])
        xy = np.vstack((scan.xy, scan.sensor)) @ np.array([[c, s], [-s, c]]) + pose[:2]
        if not np.abs(xy).max() <= MAX_CELLS * cell:  # no grid reaches there, and the number may not even fit an integer
            return False
        low, high = np.floor(xy.min(axis=0) / cell).astype(int), np.floor(xy.max(axis=0) / cell).astype(int) + 1
        height, width = self._seen.shape
        old_low = np.array(self._low)
        old_high = old_low + np.array([width, height])
        if width and (low >= old_low).all() and (high <= old_high).all():
            return True
        margin = math.ceil(self.settings.margin_m / cell)
        if width:
            low = np.where(low < old_low, low - margin, old_low)
            high = np.where(high > old_high, high + margin, old_high)
        else:
            low, high = low - margin, high + margin
        shape = (int(high[1] - low[1]), int(high[0] - low[0]))
        if shape[0] * shape[1] > MAX_CELLS:
            return False
        row, column = int(old_low[1] - low[1]), int(old_low[0] - low[0])
        for name in ("_seen", "_hit"):
            grown = np.zeros(shape, np.int32)
            if width:
                grown[row : row + height, column : column + width] = getattr(self, name)
            setattr(self, name, grown)
        self._low = (int(low[0]), int(low[1]))
        return True
