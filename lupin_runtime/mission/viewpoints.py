"""Poses from which the camera would see surfaces that it has not seen yet."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2
from lupin_runtime.mission.clearance import ClearanceMap
from lupin_runtime.mission.coverage import Coverage
from lupin_runtime.mission.kernels import travel_distances
from lupin_runtime.mission.view_planning import greedy_cover, order_viewpoints

Floats = NDArray[np.float64]

MIN_GAIN_M = 0.15
MAX_VIEWPOINTS = 40  # of one tour; another tour is planned after it
_MAX_RANKED = 20
_MAX_SURFACES = 150  # surfaces for which candidate poses are generated
_DISTANCES_M = (1.0, 0.8, 1.2, 1.4, 0.6)
_TURNS_RAD = (0.0, math.radians(30.0), math.radians(-30.0))
_TURN_COST_M = 0.3  # a turn of the robot by one radian costs as much as this travel distance


@dataclass(frozen=True)
class Viewpoint:
    """A pose of the robot that shows `gain_m` meters of unseen surface, `travel_m` meters of travel away."""

    pose: Pose2
    gain_m: float
    travel_m: float


@dataclass(frozen=True)
class ViewpointPlanner:
    """Plans viewpoints on one map, from the surfaces that are unseen according to `coverage`.

    `travel_m` (height, width) are travel distances from the robot. Viewpoints keep `viewpoint_room_m` to obstacles, paths
    between them `travel_room_m`.
    """

    coverage: Coverage
    clearance: ClearanceMap
    travel_m: NDArray[np.float32]
    viewpoint_room_m: float
    travel_room_m: float

    def rank(self, robot: Pose2, include_unknown: bool = True) -> list[Viewpoint]:
        """Return up to 20 reachable viewpoints, best first.

        The score is gain / (1 + travel distance), with a turn of the robot counted as travel. Without `include_unknown`,
        surfaces of unknown cells are ignored.
        """
        view = self.coverage.update(self.clearance.grid)
        rows, weights = self.coverage.unseen(include_unknown)
        poses, travel = self._reachable_candidates(rows)
        if not len(poses):
            return []
        gains = view.gains(rows, weights, poses)
        turns = np.abs((poses[:, 2] - robot.yaw + math.pi) % (2.0 * math.pi) - math.pi)
        scores = gains / (1.0 + travel + _TURN_COST_M * turns)
        worthwhile = np.flatnonzero(gains >= MIN_GAIN_M)
        order = worthwhile[np.argsort(-scores[worthwhile], kind="stable")]
        return [_viewpoint(poses[i], gains[i], travel[i]) for i in order[:_MAX_RANKED]]

    def tour(self) -> list[Viewpoint]:
        """Return viewpoints that together show all surfaces still to be seen, in the order of a short tour."""
        view = self.coverage.update(self.clearance.grid)
        rows, weights = self.coverage.unseen()
        poses, travel = self._reachable_candidates(rows)
        if not len(poses):
            return []
        resolution_m = self.clearance.grid.resolution_m
        visible = view.visibility(rows, poses)
        chosen = greedy_cover(visible, weights, MIN_GAIN_M / resolution_m, MAX_VIEWPOINTS)
        distance_fields = [travel_distances(self.clearance, Pose2(*poses[i, :3]), self.travel_room_m) for i in chosen]
        cells = [self.clearance.grid.cell_of(poses[i, 0], poses[i, 1]) for i in chosen]
        between = np.array([[field[cell] if field is not None else math.inf for cell in cells] for field in distance_fields])
        gains = visible @ weights * resolution_m
        viewpoints = [_viewpoint(poses[i], gains[i], travel[i]) for i in chosen]
        return [viewpoints[k] for k in order_viewpoints(travel[chosen], between)]

    def _reachable_candidates(self, rows: Floats) -> tuple[Floats, Floats]:
        """Return reachable poses (n, 4) in front of surfaces, with room for the robot, and the travel distance to each (n,)."""
        if not len(rows):
            return np.empty((0, 4)), np.empty(0)
        poses = _candidates(rows[:: max(1, len(rows) // _MAX_SURFACES)])
        grid = self.clearance.grid
        r = np.floor((poses[:, 1] - grid.origin_y) / grid.resolution_m).astype(int)
        c = np.floor((poses[:, 0] - grid.origin_x) / grid.resolution_m).astype(int)
        in_grid = (r >= 0) & (r < grid.height) & (c >= 0) & (c < grid.width)
        poses, r, c = poses[in_grid], r[in_grid], c[in_grid]
        has_room = self.clearance.distance_m[r, c] >= self.viewpoint_room_m
        reachable = self.clearance.free[r, c] & has_room & np.isfinite(self.travel_m[r, c])
        return np.ascontiguousarray(poses[reachable]), self.travel_m[r[reachable], c[reachable]].astype(np.float64)


def is_worthwhile(coverage: Coverage, pose: Pose2) -> bool:
    """Return whether a pose would show enough unseen surface on the map of the coverage's last update."""
    if coverage.view is None:
        return False
    rows, weights = coverage.unseen()
    gains = coverage.view.gains(rows, weights, np.array([[pose.x, pose.y, pose.yaw, 1.0]]))
    return float(gains[0]) >= MIN_GAIN_M


def _viewpoint(pose: Floats, gain_m: float, travel_m: float) -> Viewpoint:
    return Viewpoint(Pose2(float(pose[0]), float(pose[1]), float(pose[2])), float(gain_m), float(travel_m))


def _candidates(rows: Floats) -> Floats:
    """Return poses (n, 4) of the base, 0.6 to 1.4 m in front of surfaces (m, 4) and facing them."""
    candidates = []
    for distance in _DISTANCES_M:
        for turn in _TURNS_RAD:
            c, s = math.cos(turn), math.sin(turn)
            nx, ny = c * rows[:, 2] - s * rows[:, 3], s * rows[:, 2] + c * rows[:, 3]
            x, y = rows[:, 0] + distance * nx, rows[:, 1] + distance * ny
            candidates.append(np.stack((x, y, np.arctan2(-ny, -nx), np.ones(len(rows))), axis=1))
    return np.concatenate(candidates)
