"""An occupancy grid of keyframe scans: per cell, how many beams ended in it of those that met it.

A counting model (Haehnel et al., IROS 2003). Counters commute, so a scan that the graph moves is taken back at its old pose and
added at its new one; after a closure this is done a few scans at a time, and the map is never rebuilt from nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.gridmap import UNKNOWN, GridMap
from lupin_runtime.slam import kernels
from lupin_runtime.slam.scan import Scan

Array = NDArray[np.floating]


@dataclass(frozen=True)
class OccupancySettings:
    """Cell size; beams that must have met a cell before it counts as seen; share of them that must end there for a wall."""

    resolution_m: float = 0.05
    least_beams: int = 2
    occupied_share: float = 0.25
    margin_m: float = 4.0
    moved_m: float = 0.01
    moved_rad: float = 0.002


@dataclass
class _Drawn:
    scan: Scan
    pose: Array


class OccupancyMap:
    """The grid, which grows with what is drawn into it. Scans go by a key, each drawn once."""

    def __init__(self, settings: OccupancySettings | None = None) -> None:
        self.settings = settings or OccupancySettings()
        self._seen = np.zeros((0, 0), np.int32)
        self._hit = np.zeros((0, 0), np.int32)
        self._low = (0, 0)  # of cell (0, 0), in cells from the frame's origin: (column, row)
        self._drawn: dict[int, _Drawn] = {}
        self._waiting: dict[int, Array] = {}

    def __len__(self) -> int:
        return len(self._drawn)

    @property
    def waiting(self) -> int:
        """Scans that still stand where the graph no longer has them."""
        return len(self._waiting)

    def draw(self, key: int, scan: Scan, pose: Array) -> None:
        """Draw a scan at a pose (3,); one that had this key disappears."""
        self._waiting.pop(key, None)
        if key in self._drawn:
            self._count(self._drawn[key], -1)
        drawn = _Drawn(scan, pose.copy())
        self._make_room(scan, pose)
        self._count(drawn, 1)
        self._drawn[key] = drawn

    def move(self, poses: dict[int, Array]) -> None:
        """Note where scans belong now; `work` moves them."""
        s = self.settings
        for key, pose in poses.items():
            at = self._drawn[key].pose
            turn = abs((pose[2] - at[2] + math.pi) % (2 * math.pi) - math.pi)
            if abs(pose[0] - at[0]) + abs(pose[1] - at[1]) > s.moved_m or turn > s.moved_rad:
                self._waiting[key] = pose.copy()
            else:
                self._waiting.pop(key, None)

    def work(self, most: int) -> None:
        """Move up to `most` of the scans that wait."""
        for key in list(self._waiting)[:most]:
            self.draw(key, self._drawn[key].scan, self._waiting[key])

    def grid(self) -> GridMap | None:
        """The map as far as it is known; None before the first scan. Its corner is a whole number of cells from the origin."""
        if not self._drawn:
            return None
        s = self.settings
        cells = kernels.grade_cells(self._seen, self._hit, s.least_beams, s.occupied_share)
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

    def _make_room(self, scan: Scan, pose: Array) -> None:
        cell = self.settings.resolution_m
        c, s = math.cos(pose[2]), math.sin(pose[2])
        xy = np.vstack((scan.xy, scan.sensor)) @ np.array([[c, s], [-s, c]]) + pose[:2]
        low, high = np.floor(xy.min(axis=0) / cell).astype(int), np.floor(xy.max(axis=0) / cell).astype(int) + 1
        height, width = self._seen.shape
        here = np.array(self._low)
        there = here + np.array([width, height])
        if width and (low >= here).all() and (high <= there).all():
            return
        margin = math.ceil(self.settings.margin_m / cell)
        if width:
            low = np.where(low < here, low - margin, here)
            high = np.where(high > there, high + margin, there)
        else:
            low, high = low - margin, high + margin
        shape = (int(high[1] - low[1]), int(high[0] - low[0]))
        row, column = int(here[1] - low[1]), int(here[0] - low[0])
        for name in ("_seen", "_hit"):
            grown = np.zeros(shape, np.int32)
            if width:
                grown[row : row + height, column : column + width] = getattr(self, name)
            setattr(self, name, grown)
        self._low = (int(low[0]), int(low[1]))
