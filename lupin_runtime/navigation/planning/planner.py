"""Plans paths to drive: short, but with clearance on both sides where there is room."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.navigation.costmap import LETHAL, UNKNOWN, Costmap
from lupin_runtime.navigation.costmap.kernels import squared_distances
from lupin_runtime.navigation.planning import kernels
from lupin_runtime.navigation.planning.paths import Plan, resample, smooth

Point = tuple[float, float]

# This radius is certainly under the robot's hull; walls within it are errors of the map.
_HULL_M = 0.13

# On a map of more cells (50 x 50 m) fast marching covers only the surroundings of the shortest path.
_WHOLE_CELLS = 1_000_000
_CORRIDOR_M = 2.5
_BLOCK = 8


class PlanFailure(Enum):
    """Why there is no path; the names are the error constants of nav2_msgs/action/ComputePathToPose."""

    START_OUTSIDE_MAP = "start outside the map"
    GOAL_OUTSIDE_MAP = "goal outside the map"
    START_OCCUPIED = "start occupied"
    GOAL_OCCUPIED = "goal occupied"
    NO_VALID_PATH = "no valid path"


class NoPath(Exception):
    """There is no path; `failure` is the reason as an error constant of the action."""

    def __init__(self, failure: PlanFailure, message: str) -> None:
        super().__init__(message)
        self.failure = failure


@dataclass(frozen=True)
class PlannerParameters:
    """`tolerance`: how far from the goal a path may end if the goal cannot be reached (m).

    Within `preferred_clearance_m` of an obstacle a meter costs up to `1 + clearance_weight` times as much, so that a path
    runs in the middle of an aisle and takes corners wide; within `tight_m` of the robot's hull it costs `tight_cost` times as
    much, since a sampling controller drives there slowly or not at all. Unknown space costs `unknown_cost` times
    as much as free space.
    """

    tolerance: float = 0.5
    allow_unknown: bool = True
    robot_radius_m: float = 0.22
    preferred_clearance_m: float = 0.5
    clearance_weight: float = 4.0
    tight_m: float = 0.05
    tight_cost: float = 15.0
    unknown_cost: float = 1.5
    escape_m: float = 0.6
    escape_cost: float = 20.0
    spacing_m: float = 0.05


def plan(costmap: Costmap, start: Point, goal: Point, parameters: PlannerParameters | None = None) -> Plan:
    """Plan a path in the costmap's frame from `start` to `goal`, or to the nearest reachable point within the tolerance.

    It keeps the robot's radius from the centers of lethal cells, except near a start that is nearer, so that a
    robot that is already too near to an obstacle may leave. Raises NoPath.
    """
    p = parameters or PlannerParameters()
    start_cell, goal_cell = _inside(costmap, start, goal)
    slowness = _slowness(costmap, p, _corridor(costmap, start, goal, p))
    if slowness[start_cell] <= 0.0:
        _open_surroundings(slowness, costmap, start_cell, p)
    blocked = slowness[goal_cell] <= 0.0
    times, reached = kernels.march(slowness, start_cell, None if blocked else goal_cell)
    if not reached:
        found = _nearest_reached(times, costmap, goal, p.tolerance)
        if found is None:
            raise _failure(costmap, start, goal, goal_cell, times, p)
        goal_cell, goal = found, _center(costmap, found)
    cells = kernels.descend(times, _in_cells(costmap, goal), start_cell)
    points = np.array([costmap.origin_x, costmap.origin_y]) + cells[::-1] * costmap.resolution_m
    points = np.vstack((start, points[1:] if len(points) > 2 else points[-1:]))
    points = resample(points, p.spacing_m)
    return Plan(_smooth_in_free_space(points, costmap, slowness))


def _inside(costmap: Costmap, start: Point, goal: Point) -> tuple[kernels.Cell, kernels.Cell]:
    for point, name, failure in (
        (start, "start", PlanFailure.START_OUTSIDE_MAP),
        (goal, "goal", PlanFailure.GOAL_OUTSIDE_MAP),
    ):
        if not all(map(math.isfinite, point)) or not costmap.contains(*costmap.cell_of(*point)):
            height, width = costmap.cost.shape
            raise NoPath(
                failure,
                f"the {name} ({point[0]:.2f}, {point[1]:.2f}) is outside the map, which reaches from "
                f"({costmap.origin_x:.2f}, {costmap.origin_y:.2f}) to ({costmap.origin_x + width * costmap.resolution_m:.2f}, "
                f"{costmap.origin_y + height * costmap.resolution_m:.2f})",
            )
    return costmap.cell_of(*start), costmap.cell_of(*goal)


def _corridor(costmap: Costmap, start: Point, goal: Point, p: PlannerParameters) -> NDArray[np.bool_] | None:
    """Return the cells near the shortest path of a map too large for fast marching; None for all cells."""
    if costmap.cost.size <= _WHOLE_CELLS:
        return None
    blocked = costmap.distance_m <= p.robot_radius_m
    if not p.allow_unknown:
        blocked |= costmap.cost == UNKNOWN
    if blocked[costmap.cell_of(*start)]:
        return None
    path = kernels.shortest_path(
        *(blocked.view(np.uint8), blocked.view(np.uint8)),
        *(_in_cells(costmap, start), _in_cells(costmap, goal)),
        p.tolerance / costmap.resolution_m,
        0.0,
    )
    if path is None:
        return None
    height, width = blocked.shape
    coarse = np.zeros((-(-height // _BLOCK), -(-width // _BLOCK)), np.uint8)
    along = (resample(path, _BLOCK / 2) / _BLOCK).astype(np.int64)
    coarse[along[:, 1], along[:, 0]] = 1
    reach = max(1, math.ceil(_CORRIDOR_M / (_BLOCK * costmap.resolution_m)))
    near = squared_distances(coarse, reach) <= reach * reach
    return np.repeat(np.repeat(near, _BLOCK, axis=0), _BLOCK, axis=1)[:height, :width]


def _slowness(costmap: Costmap, p: PlannerParameters, corridor: NDArray[np.bool_] | None) -> NDArray[np.float32]:
    if corridor is None:
        return _slowness_of(costmap.distance_m, costmap.cost, p)
    slowness = np.zeros(costmap.cost.shape, np.float32)
    slowness[corridor] = _slowness_of(costmap.distance_m[corridor], costmap.cost[corridor], p)
    return slowness


def _slowness_of(distance: NDArray[np.float32], cost: NDArray[np.uint8], p: PlannerParameters) -> NDArray[np.float32]:
    band = max(p.preferred_clearance_m - p.robot_radius_m, 1e-6)
    lack = np.clip((p.preferred_clearance_m - distance) * np.float32(1.0 / band), 0.0, 1.0)
    slowness = 1.0 + p.clearance_weight * lack * lack
    slowness[distance <= p.robot_radius_m + p.tight_m] = p.tight_cost
    unknown = cost == UNKNOWN
    if p.allow_unknown:
        slowness[unknown] *= p.unknown_cost
    else:
        slowness[unknown] = 0.0
    slowness[distance <= p.robot_radius_m] = 0.0
    return np.ascontiguousarray(slowness, np.float32)


def _open_surroundings(slowness: NDArray[np.float32], costmap: Costmap, start: kernels.Cell, p: PlannerParameters) -> None:
    """Make the robot's surroundings passable at a higher cost, so that a robot too near to an obstacle can leave."""
    reach = math.ceil(p.escape_m / costmap.resolution_m)
    rows = slice(max(0, start[0] - reach), start[0] + reach + 1)
    columns = slice(max(0, start[1] - reach), start[1] + reach + 1)
    window = slowness[rows, columns]
    r, c = np.ogrid[rows.start : rows.start + window.shape[0], columns.start : columns.start + window.shape[1]]
    away = np.hypot(r - start[0], c - start[1]) * costmap.resolution_m
    solid = (costmap.cost[rows, columns] == LETHAL) & (away > _HULL_M)
    open_up = (window <= 0.0) & (away <= p.escape_m) & ~solid
    window[open_up] = p.escape_cost


def _nearest_reached(times: NDArray[np.float32], costmap: Costmap, goal: Point, tolerance_m: float) -> kernels.Cell | None:
    row, column = costmap.cell_of(*goal)
    reach = math.ceil(tolerance_m / costmap.resolution_m)
    low_r, low_c = max(0, row - reach), max(0, column - reach)
    window = times[low_r : row + reach + 1, low_c : column + reach + 1]
    r, c = np.ogrid[low_r : low_r + window.shape[0], low_c : low_c + window.shape[1]]
    y = costmap.origin_y + (r + 0.5) * costmap.resolution_m - goal[1]
    x = costmap.origin_x + (c + 0.5) * costmap.resolution_m - goal[0]
    away = np.where(np.isfinite(window), np.hypot(x, y), np.inf)
    best = np.unravel_index(int(np.argmin(away)), away.shape)
    if not away[best] <= tolerance_m:
        return None
    return int(best[0]) + low_r, int(best[1]) + low_c


def _failure(
    costmap: Costmap, start: Point, goal: Point, cell: kernels.Cell, times: NDArray[np.float32], p: PlannerParameters
) -> NoPath:
    goal_text = f"({goal[0]:.2f}, {goal[1]:.2f})"
    if np.isfinite(times).sum() <= 1:
        return NoPath(
            PlanFailure.START_OCCUPIED,
            f"the robot at ({start[0]:.2f}, {start[1]:.2f}) is enclosed: nothing within {p.escape_m} m is free",
        )
    if costmap.distance_m[cell] <= p.robot_radius_m:
        return NoPath(
            PlanFailure.GOAL_OCCUPIED,
            f"the goal {goal_text} is {costmap.distance_m[cell]:.2f} m from an obstacle, the robot's radius is "
            f"{p.robot_radius_m} m, and no place within {p.tolerance} m of it can be reached",
        )
    return NoPath(
        PlanFailure.NO_VALID_PATH,
        f"no path of {2 * p.robot_radius_m:.2f} m width leads to {goal_text} or within {p.tolerance} m of it",
    )


def _center(costmap: Costmap, cell: kernels.Cell) -> Point:
    return (
        costmap.origin_x + (cell[1] + 0.5) * costmap.resolution_m,
        costmap.origin_y + (cell[0] + 0.5) * costmap.resolution_m,
    )


def _in_cells(costmap: Costmap, point: Point) -> Point:
    return (point[0] - costmap.origin_x) / costmap.resolution_m, (point[1] - costmap.origin_y) / costmap.resolution_m


def _smooth_in_free_space(points: NDArray[np.float64], costmap: Costmap, slowness: NDArray[np.float32]) -> NDArray[np.float64]:
    """Smooth the path, but restore every point that smoothing would move out of free space."""
    soft = smooth(points)
    columns = ((soft[:, 0] - costmap.origin_x) / costmap.resolution_m).astype(np.int64)
    rows = ((soft[:, 1] - costmap.origin_y) / costmap.resolution_m).astype(np.int64)
    stays = slowness[rows, columns] > 0.0
    return np.where(stays[:, None], soft, points)
