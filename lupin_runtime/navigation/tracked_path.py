"""A path with the robot's position on it; extracts the part that the controller follows now."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2
from lupin_runtime.navigation.costmap import Costmap
from lupin_runtime.navigation.mppi import LocalPath
from lupin_runtime.navigation.planning.paths import arc_lengths

# The longest advance on the path in one cycle. With a longer one, the robot could be matched to a later part of the path that
# returns on the other side of a table.
_MAX_ADVANCE_M = 0.7


class TrackedPath:
    """A path (n, 2) of evenly spaced points in the map frame, and the robot's position on it, which only moves forward."""

    def __init__(self, points: NDArray[np.float64]) -> None:
        self.points = points
        self._arc_lengths_m = arc_lengths(points)
        self._spacing_m = max(float(self._arc_lengths_m[-1]) / max(len(points) - 1, 1), 1e-3)
        self._index = 0

    @property
    def remaining_m(self) -> float:
        """Meters from the robot's position to the path's end."""
        return float(self._arc_lengths_m[-1] - self._arc_lengths_m[self._index])

    def advance(self, robot: Pose2) -> float:
        """Advance to the nearest point within reach; returns the robot's (map frame) distance from it in meters."""
        end = int(np.searchsorted(self._arc_lengths_m, self._arc_lengths_m[self._index] + _MAX_ADVANCE_M, side="right"))
        window = self.points[self._index : max(end, self._index + 1)]
        distances_m = np.hypot(window[:, 0] - robot.x, window[:, 1] - robot.y)
        nearest = int(np.argmin(distances_m))
        self._index += nearest
        return float(distances_m[nearest])

    def extract_local_path(
        self, odom_from_map: Pose2, robot: Pose2, costmap: Costmap, ahead_m: float, radius_m: float
    ) -> LocalPath:
        """Return the next `ahead_m` of the path in the odometry frame; `robot` is in that frame too.

        A point is free if its distance to the nearest obstacle is more than `radius_m`.
        """
        end = int(np.searchsorted(self._arc_lengths_m, self._arc_lengths_m[self._index] + ahead_m, side="right"))
        part = self.points[self._index : max(end, self._index + 1)]
        c, s = math.cos(odom_from_map.yaw), math.sin(odom_from_map.yaw)
        x = odom_from_map.x + c * part[:, 0] - s * part[:, 1]
        y = odom_from_map.y + s * part[:, 0] + c * part[:, 1]
        off_path_m = math.hypot(float(x[0]) - robot.x, float(y[0]) - robot.y)
        return LocalPath(x, y, _find_free_points(x, y, costmap, radius_m), self._spacing_m, self.remaining_m + off_path_m)


def _find_free_points(x: NDArray[np.float64], y: NDArray[np.float64], costmap: Costmap, radius_m: float) -> NDArray[np.bool_]:
    """Return which points are more than `radius_m` from any obstacle. Points outside the costmap are free."""
    height, width = costmap.distance_m.shape
    columns = np.floor((x - costmap.origin_x) / costmap.resolution_m).astype(np.int64)
    rows = np.floor((y - costmap.origin_y) / costmap.resolution_m).astype(np.int64)
    in_grid = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    free: NDArray[np.bool_] = np.ones(len(x), np.bool_)
    free[in_grid] = costmap.distance_m[rows[in_grid], columns[in_grid]] > radius_m
    return free
