"""Tracks which surfaces of the map the body camera has seen.

A lidar maps a room long before the camera has seen every side of every box in it, and tags hang on those sides. So a search
for all tags ends only when neither frontiers nor unseen surfaces are left.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2, wrap_angle
from lupin_runtime.gridmap import GridMap
from lupin_runtime.mission.kernels import CameraModel, CameraView
from lupin_runtime.mission.surfaces import Surfaces, find_surfaces

Floats = NDArray[np.float64]

MAX_SAMPLES = 4000  # bounds the cost of a new map: 4000 poses and 3000 surfaces take about 30 ms
_STILL_M, _STILL_RAD = 0.03, math.radians(3.0)


class Coverage:
    """Records the camera's poses, and computes on the newest map which surfaces were visible from them.

    Poses are stored rather than seen cells, since SLAM maps grow, shift and close loops: for each new map the seen surfaces
    are recomputed. A surface counts as seen after `min_view_s`; outer walls count with `wall_weight`, all others with 1. A
    surface that `max_tries` visited viewpoints failed to show is given up.
    """

    def __init__(
        self,
        camera: CameraModel | None = None,
        min_view_s: float = 0.5,
        wall_weight: float = 0.0,
        max_tries: int = 2,
        occupied_thresh: int = 65,
        free_thresh: int = 20,
    ) -> None:
        self._camera = camera or CameraModel()
        self._min_view_s = min_view_s
        self._wall_weight = wall_weight
        self._max_tries = max_tries
        self._occupied_thresh, self._free_thresh = occupied_thresh, free_thresh
        self._samples: list[tuple[float, float, float, float]] = []
        self._evaluated = 0  # samples whose view is part of `_seen_s`
        self._tries: dict[tuple[int, int, int], int] = {}
        self._grid: GridMap | None = None
        self._surfaces = Surfaces(np.empty((0, 4)), np.empty(0, bool), np.empty(0, bool))
        self._seen_s = np.empty(0)
        self.view: CameraView | None = None
        """The camera on the map of the last update; None before the first."""

    def note_pose(self, pose: Pose2, elapsed_s: float) -> None:
        """Record that the camera looked from the robot's pose for `elapsed_s`."""
        if not all(map(math.isfinite, (pose.x, pose.y, pose.yaw))) or elapsed_s <= 0.0:
            return
        if self._samples:
            x, y, yaw, weight = self._samples[-1]
            if math.hypot(pose.x - x, pose.y - y) < _STILL_M and abs(wrap_angle(pose.yaw - yaw)) < _STILL_RAD:
                if weight >= 2.0 * self._min_view_s:
                    return  # the robot stands still, and everything in view counts as seen
                if self._evaluated < len(self._samples):
                    self._samples[-1] = (x, y, yaw, weight + elapsed_s)
                    return
        self._samples.append((pose.x, pose.y, pose.yaw, elapsed_s))
        if len(self._samples) > MAX_SAMPLES:
            self._thin_out()

    def _thin_out(self) -> None:
        """Merge neighboring samples of the older half. Their view on the current map was evaluated before."""
        half = len(self._samples) // 2
        old = self._samples[:half]
        merged = [(*a[:3], a[3] + b[3]) for a, b in zip(old[::2], old[1::2])]
        self._evaluated = max(0, self._evaluated - (half - len(merged)))
        self._samples = merged + self._samples[2 * len(merged) :]

    def update(self, grid: GridMap) -> CameraView:
        """Update the seen surfaces for a map and for the poses recorded since the last update."""
        view = self.view
        if view is None or grid is not self._grid:
            self._grid = grid
            self._surfaces = find_surfaces(grid, self._free_thresh, self._occupied_thresh)
            view = self.view = CameraView(self._camera, grid, self._occupied_thresh)
            self._seen_s = np.zeros(len(self._surfaces.rows))
            self._evaluated = 0
        new = self._samples[self._evaluated :]
        self._evaluated = len(self._samples)
        if new and len(self._surfaces.rows):
            view.add_view_time(self._surfaces.rows, np.array(new, np.float64), self._seen_s)
        return view

    def seen_fraction(self) -> float:
        """Return the seen fraction of the surfaces that have a weight; 1 if none has one."""
        weighted = self._weights() > 0.0
        return float(np.mean(self._seen_s[weighted] >= self._min_view_s)) if weighted.any() else 1.0

    def _weights(self) -> Floats:
        return np.where(self._surfaces.wall, self._wall_weight, 1.0)

    def unseen(self, include_unknown: bool = True) -> tuple[Floats, Floats]:
        """Return rows (n, 4) and weights (n,) of the surfaces still to be seen.

        Sides of unknown cells can be excluded, since these may be free space that exploration has not reached.
        """
        weights = self._weights()
        if not include_unknown:
            weights[self._surfaces.unknown] = 0.0
        weights[self._seen_s >= self._min_view_s] = 0.0
        if self._tries:
            for index in np.flatnonzero(weights):
                if self._tries.get(_surface_key(self._surfaces.rows[index]), 0) >= self._max_tries:
                    weights[index] = 0.0
        remaining = weights > 0.0
        return np.ascontiguousarray(self._surfaces.rows[remaining]), np.ascontiguousarray(weights[remaining])

    def count_try(self, pose: Pose2) -> None:
        """Count a visit to a viewpoint as a failed try for each surface that should be visible from it but is still unseen."""
        rows, _ = self.unseen()
        if self.view is None or not len(rows):
            return
        visible = np.zeros(len(rows))
        self.view.add_view_time(rows, np.array([[pose.x, pose.y, pose.yaw, 1.0]]), visible)
        for key in {_surface_key(row) for row in rows[visible > 0.0]}:
            self._tries[key] = self._tries.get(key, 0) + 1


def _surface_key(row: Floats) -> tuple[int, int, int]:
    """Identify a surface across maps that grow or shift a little: its position in steps of 0.2 m, and its direction."""
    side = round(math.atan2(row[3], row[2]) / (math.pi / 2)) % 4
    return round(row[0] / 0.2), round(row[1] / 0.2), side
