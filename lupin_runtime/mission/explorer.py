"""Where an exploration drives next: frontiers until the map is whole, then every surface that the camera has not seen."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2
from lupin_runtime.gridmap import GridMap
from lupin_runtime.mission.approach import Clearance
from lupin_runtime.mission.coverage import Coverage, Viewpoint, travel_distances
from lupin_runtime.mission.frontier import Frontier, FrontierSettings, find_frontiers, frontier_cells

MAX_FAILURES = 3  # goals at one place that could not be reached
MAX_VISITS = 2  # arrivals after which the place is still unknown: no sensor will see more of it from there
SPOT_RADIUS_M = 0.5
FIRST_DELAY_S = 30.0  # doubles with each failure

# A viewpoint on the way is taken before a frontier farther off: coming back for it would cost the road twice.
NEAR_M, NEAR_GAIN_M = 1.5, 0.3


@dataclass(frozen=True)
class ExplorationGoal:
    """A pose in the map frame, and why to go there."""

    kind: Literal["frontier", "viewpoint"]
    pose: Pose2


@dataclass
class _Spot:
    """What has been tried at a place."""

    x: float
    y: float
    failures: int = 0
    visits: int = 0
    map_number: int = -1
    not_before_s: float = 0.0


class Explorer:
    """Chooses goals and remembers how they ended, so that the search always comes to an end.

    `map_number` counts the maps received: a place that was visited is judged again only on a newer map.
    """

    def __init__(
        self,
        frontiers: FrontierSettings | None = None,
        coverage: Coverage | None = None,
        travel_room_m: float = 0.24,
        viewpoint_room_m: float = 0.32,
    ) -> None:
        self._frontiers = frontiers or FrontierSettings()
        self._coverage = coverage
        self._travel_room_m, self._viewpoint_room_m = travel_room_m, viewpoint_room_m
        self._spots: list[_Spot] = []
        self._looked_from: Pose2 | None = None

    def note_pose(self, pose: Pose2, elapsed_s: float) -> None:
        """The robot, and so its camera, has been here for `elapsed_s`."""
        if self._coverage is not None:
            self._coverage.note_pose(pose, elapsed_s)

    def choose(self, grid: GridMap, map_number: int, robot: Pose2 | None, now_s: float) -> ExplorationGoal | None:
        """The next goal, or None where nothing is left to look at on this map."""
        robot_xy = (robot.x, robot.y) if robot is not None else None
        found = [
            frontier
            for frontier in find_frontiers(grid, robot_xy, self._frontiers)
            if self._worth_another_try(frontier, map_number)
        ]
        clearance, travel = None, None
        if robot is not None:
            clearance = Clearance.of(grid, self._frontiers.free_thresh, self._frontiers.occupied_thresh)
            travel = travel_distances(clearance, robot, self._travel_room_m)
        reachable = [f for f in found if self._road_m(f, grid, travel) < math.inf]
        ready = [f for f in reachable if self._spot(f.x, f.y).not_before_s <= now_s]
        # The unknown is a matter of frontiers while there are any: what is left of it then is the side of something.
        viewpoint = self._viewpoint(grid, clearance, travel, robot, unknown=not ready)
        if ready:
            best = ready[0]
            if viewpoint is not None and self._on_the_way(viewpoint, self._road_m(best, grid, travel)):
                return self._look(viewpoint)
            return self._frontier_goal(best, robot)
        if viewpoint is not None:
            return self._look(viewpoint)
        # What failed lately, then what no known road leads to: the planner may know better, but only once.
        unreachable = [f for f in found if f not in reachable and self._spot(f.x, f.y).failures == 0]
        for frontier in reachable + unreachable:
            return self._frontier_goal(frontier, robot)
        return None

    def is_useful(self, goal: ExplorationGoal, grid: GridMap) -> bool:
        """Whether going on to a goal still shows something new on this map."""
        if goal.kind == "viewpoint":
            if self._coverage is None:
                return False
            self._coverage.update(grid)
            return self._coverage.worth_going(goal.pose)
        mask = frontier_cells(grid, self._frontiers)
        row, column = grid.cell_of(goal.pose.x, goal.pose.y)
        reach = math.ceil(SPOT_RADIUS_M / grid.resolution_m)
        r0, c0 = max(0, row - reach), max(0, column - reach)
        return bool(mask[r0 : max(0, row + reach + 1), c0 : max(0, column + reach + 1)].any())

    def arrived(self, goal: ExplorationGoal, map_number: int) -> None:
        """The robot is at a goal."""
        if goal.kind == "frontier":
            spot = self._spot(goal.pose.x, goal.pose.y, keep=True)
            spot.visits += 1
            spot.map_number = map_number

    def failed(self, goal: ExplorationGoal, map_number: int, now_s: float) -> None:
        """The robot could not get to a goal."""
        if goal.kind == "frontier":
            spot = self._spot(goal.pose.x, goal.pose.y, keep=True)
            spot.not_before_s = now_s + FIRST_DELAY_S * 2**spot.failures
            spot.failures += 1
            spot.map_number = map_number

    def forgotten(self, goal: ExplorationGoal) -> None:
        """A goal was given up by the operator or for something better: that says nothing about the place."""
        if goal.kind == "viewpoint":
            self._looked_from = None

    def _spot(self, x: float, y: float, keep: bool = False) -> _Spot:
        near = min(self._spots, key=lambda s: math.hypot(s.x - x, s.y - y), default=None)
        if near is not None and math.hypot(near.x - x, near.y - y) <= SPOT_RADIUS_M:
            return near
        fresh = _Spot(x, y)
        if keep:
            self._spots.append(fresh)
        return fresh

    def _worth_another_try(self, frontier: Frontier, map_number: int) -> bool:
        spot = self._spot(frontier.x, frontier.y)
        if spot.failures >= MAX_FAILURES or spot.visits >= MAX_VISITS:
            return False
        # The map lags behind the robot by up to its update interval: what it showed at arrival is no evidence.
        return spot.visits == 0 or map_number > spot.map_number

    def _road_m(self, frontier: Frontier, grid: GridMap, travel: NDArray[np.float32] | None) -> float:
        """Metres by road, 0 where the robot's place is unknown."""
        if travel is None:
            return 0.0
        row, column = grid.cell_of(frontier.x, frontier.y)
        near = travel[max(0, row - 2) : row + 3, max(0, column - 2) : column + 3]
        return float(near.min()) if near.size else math.inf

    def _viewpoint(
        self,
        grid: GridMap,
        clearance: Clearance | None,
        travel: NDArray[np.float32] | None,
        robot: Pose2 | None,
        unknown: bool,
    ) -> Viewpoint | None:
        if self._coverage is None or clearance is None or travel is None or robot is None:
            return None
        self._coverage.update(grid)
        if self._looked_from is not None:
            self._coverage.give_up_slowly(self._looked_from)
            self._looked_from = None
        if unknown:
            options = self._coverage.tour(clearance, travel, self._viewpoint_room_m, self._travel_room_m)
        else:
            options = self._coverage.viewpoints(clearance, travel, robot, self._viewpoint_room_m, unknown)
        return options[0] if options else None

    @staticmethod
    def _on_the_way(viewpoint: Viewpoint, frontier_road_m: float) -> bool:
        return viewpoint.travel_m <= NEAR_M and viewpoint.travel_m < frontier_road_m and viewpoint.gain_m >= NEAR_GAIN_M

    def _look(self, viewpoint: Viewpoint) -> ExplorationGoal:
        self._looked_from = viewpoint.pose
        return ExplorationGoal("viewpoint", viewpoint.pose)

    @staticmethod
    def _frontier_goal(frontier: Frontier, robot: Pose2 | None) -> ExplorationGoal:
        yaw = math.atan2(frontier.y - robot.y, frontier.x - robot.x) if robot is not None else 0.0
        return ExplorationGoal("frontier", Pose2(frontier.x, frontier.y, yaw))
