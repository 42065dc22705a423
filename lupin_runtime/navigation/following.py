"""Keeping one's place on a path, and cutting out the part of it that the controller is to follow now."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2
from lupin_runtime.navigation.costmap import Costmap
from lupin_runtime.navigation.mppi import LocalPath
from lupin_runtime.navigation.planning.paths import arc_lengths

# How far ahead on the path the robot may turn out to be between two cycles. Short, so that a path that comes back on the
# other side of a table is not mistaken for the present place.
_SEARCH_M = 0.7


class TrackedPath:
    """A path (n, 2) of evenly spaced points in the map frame, and the robot's place on it, which only moves forward."""

    def __init__(self, points: NDArray[np.float64]) -> None:
        self.points = points
        self._along = arc_lengths(points)
        self._spacing_m = max(float(self._along[-1]) / max(len(points) - 1, 1), 1e-3)
        self._at = 0

    @property
    def remaining_m(self) -> float:
        """Metres from the robot's place to the path's end."""
        return float(self._along[-1] - self._along[self._at])

    def advance(self, robot: Pose2) -> float:
        """Move the place to the nearest point ahead; returns how far the robot (map frame) is from it, in metres."""
        end = int(np.searchsorted(self._along, self._along[self._at] + _SEARCH_M, side="right"))
        window = self.points[self._at : max(end, self._at + 1)]
        away = np.hypot(window[:, 0] - robot.x, window[:, 1] - robot.y)
        nearest = int(np.argmin(away))
        self._at += nearest
        return float(away[nearest])

    def local(self, odom_from_map: Pose2, robot: Pose2, costmap: Costmap, ahead_m: float, radius_m: float) -> LocalPath:
        """The next `ahead_m` of the path in the odometry frame; `robot` is in that frame too."""
        end = int(np.searchsorted(self._along, self._along[self._at] + ahead_m, side="right"))
        part = self.points[self._at : max(end, self._at + 1)]
        c, s = math.cos(odom_from_map.yaw), math.sin(odom_from_map.yaw)
        x = odom_from_map.x + c * part[:, 0] - s * part[:, 1]
        y = odom_from_map.y + s * part[:, 0] + c * part[:, 1]
        off = math.hypot(float(x[0]) - robot.x, float(y[0]) - robot.y)
        return LocalPath(x, y, _free(x, y, costmap, radius_m), self._spacing_m, self.remaining_m + off)


def _free(x: NDArray[np.float64], y: NDArray[np.float64], costmap: Costmap, radius_m: float) -> NDArray[np.bool_]:
    height, width = costmap.distance_m.shape
    columns = np.floor((x - costmap.origin_x) / costmap.resolution_m).astype(np.int64)
    rows = np.floor((y - costmap.origin_y) / costmap.resolution_m).astype(np.int64)
    inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    free: NDArray[np.bool_] = np.ones(len(x), np.bool_)
    free[inside] = costmap.distance_m[rows[inside], columns[inside]] > radius_m
    return free
