"""Chooses where an exploration drives next: frontiers until the map is complete, then surfaces the camera has not seen."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2
from lupin_runtime.gridmap import GridMap
from lupin_runtime.mission.clearance import ClearanceMap
from lupin_runtime.mission.coverage import Coverage
from lupin_runtime.mission.frontier import Frontier, FrontierSettings, find_frontiers, frontier_cells
from lupin_runtime.mission.kernels import travel_distances
from lupin_runtime.mission.viewpoints import Viewpoint, ViewpointPlanner, is_worthwhile

MAX_FAILURES = 3  # failed drives to one place
MAX_VISITS = 2  # arrivals after which a place that is still a frontier is given up: no sensor sees more of it from there
PLACE_RADIUS_M = 0.5
FIRST_DELAY_S = 30.0  # before a failed place is tried again; doubles with each failure

# A viewpoint within this travel distance, with this gain, comes before a frontier farther away: returning to it later would
# mean driving the distance twice.
DETOUR_M, DETOUR_GAIN_M = 1.5, 0.3


@dataclass(frozen=True)
class ExplorationGoal:
    """A pose in the map frame, and what the robot is to see from it."""

    kind: Literal["frontier", "viewpoint"]
    pose: Pose2


@dataclass
class _TriedPlace:
    """The visits and failures at a place; `map_number` is the map at the last of them."""

    x: float
    y: float
    failures: int = 0
    visits: int = 0
    map_number: int = -1
    not_before_s: float = 0.0


class Explorer:
    """Chooses goals and remembers their results, so that every search ends.

    `coverage` None searches frontiers only. `map_number` counts the maps received: a place that was visited is judged again
    on a newer map only.
    """

    def __init__(
        self,
        frontiers: FrontierSettings | None = None,
        coverage: Coverage | None = None,
        travel_room_m: float = 0.24,
        viewpoint_room_m: float = 0.32,
    ) -> None:
        self._settings = frontiers or FrontierSettings()
        self._coverage = coverage
        self._travel_room_m, self._viewpoint_room_m = travel_room_m, viewpoint_room_m
        self._tried: list[_TriedPlace] = []
        self._last_viewpoint: Pose2 | None = None

    def note_pose(self, pose: Pose2, elapsed_s: float) -> None:
        """Record that the robot, and so its camera, was at a pose for `elapsed_s`."""
        if self._coverage is not None:
            self._coverage.note_pose(pose, elapsed_s)

    def choose(self, grid: GridMap, map_number: int, robot: Pose2 | None, now_s: float) -> ExplorationGoal | None:
        """Return the next goal, or None if this map leaves nothing to explore."""
        robot_xy = (robot.x, robot.y) if robot is not None else None
        frontiers = [f for f in find_frontiers(grid, robot_xy, self._settings) if self._may_be_tried(f, map_number)]
        clearance, travel = None, None
        if robot is not None:
            clearance = ClearanceMap.from_grid(grid, self._settings.free_thresh, self._settings.occupied_thresh)
            travel = travel_distances(clearance, robot, self._travel_room_m)
        reachable = [f for f in frontiers if _travel_to(f, grid, travel) < math.inf]
        candidates = [f for f in reachable if self._find_place(f.x, f.y).not_before_s <= now_s]
        # Frontiers explore unknown cells. Only once no frontier is left, unknown cells count as sides of objects.
        viewpoint = self._viewpoint(clearance, travel, robot, include_unknown=not candidates)
        if candidates:
            best = candidates[0]
            if viewpoint is not None and _is_worth_a_detour(viewpoint, _travel_to(best, grid, travel)):
                return self._viewpoint_goal(viewpoint)
            return _frontier_goal(best, robot)
        if viewpoint is not None:
            return self._viewpoint_goal(viewpoint)
        # Frontiers that failed recently, then those without a known path: the planner may find one, but is tried only once.
        unreachable = [f for f in frontiers if f not in reachable and self._find_place(f.x, f.y).failures == 0]
        last_resort = reachable + unreachable
        return _frontier_goal(last_resort[0], robot) if last_resort else None

    def is_useful(self, goal: ExplorationGoal, grid: GridMap) -> bool:
        """Return whether a goal still shows something new on this map."""
        if goal.kind == "viewpoint":
            if self._coverage is None:
                return False
            self._coverage.update(grid)
            return is_worthwhile(self._coverage, goal.pose)
        mask = frontier_cells(grid, self._settings)
        row, column = grid.cell_of(goal.pose.x, goal.pose.y)
        reach = math.ceil(PLACE_RADIUS_M / grid.resolution_m)
        r0, c0 = max(0, row - reach), max(0, column - reach)
        return bool(mask[r0 : max(0, row + reach + 1), c0 : max(0, column + reach + 1)].any())

    # -- results of goals ----------------------------------------------------------------------------------------------

    def record_arrival(self, goal: ExplorationGoal, map_number: int) -> None:
        """Record that the robot arrived at a goal."""
        if goal.kind == "frontier":
            place = self._find_place(goal.pose.x, goal.pose.y, keep=True)
            place.visits += 1
            place.map_number = map_number

    def record_failure(self, goal: ExplorationGoal, map_number: int, now_s: float) -> None:
        """Record that the robot could not reach a goal."""
        if goal.kind == "frontier":
            place = self._find_place(goal.pose.x, goal.pose.y, keep=True)
            place.not_before_s = now_s + FIRST_DELAY_S * 2**place.failures
            place.failures += 1
            place.map_number = map_number

    def record_abandonment(self, goal: ExplorationGoal) -> None:
        """Record that a goal was given up, by the operator or for a better one. It does not count as a failure."""
        if goal.kind == "viewpoint":
            self._last_viewpoint = None

    def _find_place(self, x: float, y: float, keep: bool = False) -> _TriedPlace:
        """Return the tried place within PLACE_RADIUS_M, else a new one, which is stored if `keep`."""
        nearest = min(self._tried, key=lambda p: math.hypot(p.x - x, p.y - y), default=None)
        if nearest is not None and math.hypot(nearest.x - x, nearest.y - y) <= PLACE_RADIUS_M:
            return nearest
        place = _TriedPlace(x, y)
        if keep:
            self._tried.append(place)
        return place

    def _may_be_tried(self, frontier: Frontier, map_number: int) -> bool:
        place = self._find_place(frontier.x, frontier.y)
        if place.failures >= MAX_FAILURES or place.visits >= MAX_VISITS:
            return False
        # The map lags behind the robot by up to its update interval, so the map at arrival proves nothing.
        return place.visits == 0 or map_number > place.map_number

    # -- viewpoints ----------------------------------------------------------------------------------------------------

    def _viewpoint(
        self, clearance: ClearanceMap | None, travel: NDArray[np.float32] | None, robot: Pose2 | None, include_unknown: bool
    ) -> Viewpoint | None:
        if self._coverage is None or clearance is None or travel is None or robot is None:
            return None
        self._coverage.update(clearance.grid)
        if self._last_viewpoint is not None:
            self._coverage.count_try(self._last_viewpoint)
            self._last_viewpoint = None
        planner = ViewpointPlanner(self._coverage, clearance, travel, self._viewpoint_room_m, self._travel_room_m)
        found = planner.tour() if include_unknown else planner.rank(robot, include_unknown)
        return found[0] if found else None

    def _viewpoint_goal(self, viewpoint: Viewpoint) -> ExplorationGoal:
        self._last_viewpoint = viewpoint.pose
        return ExplorationGoal("viewpoint", viewpoint.pose)


def _is_worth_a_detour(viewpoint: Viewpoint, frontier_travel_m: float) -> bool:
    near = viewpoint.travel_m <= DETOUR_M and viewpoint.travel_m < frontier_travel_m
    return near and viewpoint.gain_m >= DETOUR_GAIN_M


def _travel_to(frontier: Frontier, grid: GridMap, travel: NDArray[np.float32] | None) -> float:
    """Return the travel distance to a frontier in meters; 0 if the robot's position is unknown."""
    if travel is None:
        return 0.0
    row, column = grid.cell_of(frontier.x, frontier.y)
    near = travel[max(0, row - 2) : row + 3, max(0, column - 2) : column + 3]
    return float(near.min()) if near.size else math.inf


def _frontier_goal(frontier: Frontier, robot: Pose2 | None) -> ExplorationGoal:
    yaw = math.atan2(frontier.y - robot.y, frontier.x - robot.x) if robot is not None else 0.0
    return ExplorationGoal("frontier", Pose2(frontier.x, frontier.y, yaw))
