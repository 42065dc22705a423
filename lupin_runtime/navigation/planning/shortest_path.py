"""The shortest path of a disc through a map, for `lupin map plan`; the robot itself uses `planner.plan`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.gridmap import GridMap
from lupin_runtime.navigation.costmap.costs import OCCUPIED_PERCENT
from lupin_runtime.navigation.costmap.kernels import MAX_EDGE_REACH_CELLS, squared_distances
from lupin_runtime.navigation.planning import kernels
from lupin_runtime.navigation.planning.paths import Plan
from lupin_runtime.navigation.planning.planner import NoPath, PlanFailure, Point


def find_shortest_path(
    grid: GridMap,
    start: Point,
    goal: Point,
    radius_m: float,
    tolerance_m: float = 0.0,
    allow_unknown: bool = True,
) -> Plan:
    """Find the shortest path of a disc of `radius_m` from `start` to `goal` (meters, map frame): lines of any angle.

    Occupied cells are solid squares, and so are unknown ones unless `allow_unknown`. The path keeps `radius_m` from them, to a
    fiftieth of a cell. If the goal cannot be reached, the path ends at the nearest reachable point within `tolerance_m`.
    Raises NoPath, and ValueError for a radius that does not fit the grid.
    """
    resolution = grid.resolution_m
    if not (math.isfinite(radius_m) and 0.0 <= radius_m <= (MAX_EDGE_REACH_CELLS - 1) * resolution):
        raise ValueError(f"a radius of {radius_m} m is not within 0 .. {(MAX_EDGE_REACH_CELLS - 1) * resolution:g} m")
    for point, name, failure in (
        (start, "start", PlanFailure.START_OUTSIDE_MAP),
        (goal, "goal", PlanFailure.GOAL_OUTSIDE_MAP),
    ):
        if not all(map(math.isfinite, point)) or not grid.contains(*grid.cell_of(*point)):
            far_x, far_y = grid.origin_x + grid.width * resolution, grid.origin_y + grid.height * resolution
            raise NoPath(
                failure,
                f"the {name} ({point[0]:g}, {point[1]:g}) is outside the map, which reaches from "
                f"({grid.origin_x:g}, {grid.origin_y:g}) to ({far_x:g}, {far_y:g})",
            )
    obstacles = (grid.cells >= OCCUPIED_PERCENT).view(np.uint8)
    solid = obstacles if allow_unknown else obstacles | (grid.cells < 0).view(np.uint8)
    blocked = _within(radius_m / resolution, solid)

    def why_blocked(name: str, point: Point) -> str:
        where, cell = f"the {name} ({point[0]:g}, {point[1]:g})", grid.cell_of(*point)
        if _within(radius_m / resolution, obstacles)[cell]:
            return f"{where} is within {radius_m:g} m of an obstacle"
        return f"{where} is in unknown space" if solid[cell] else f"{where} is within {radius_m:g} m of unknown space"

    if blocked[grid.cell_of(*start)]:
        raise NoPath(PlanFailure.START_OCCUPIED, why_blocked("start", start))
    first, last = (((x - grid.origin_x) / resolution, (y - grid.origin_y) / resolution) for x, y in (start, goal))
    cells = kernels.shortest_path(blocked, solid, first, last, tolerance_m / resolution, radius_m / resolution)
    if cells is not None:
        return Plan(np.array([grid.origin_x, grid.origin_y]) + cells * resolution)
    near = f" or to within {tolerance_m:g} m of it" if tolerance_m > 0.0 else ""
    if blocked[grid.cell_of(*goal)]:
        raise NoPath(PlanFailure.GOAL_OCCUPIED, why_blocked("goal", goal))
    through = "" if allow_unknown else " through known space"
    raise NoPath(
        PlanFailure.NO_VALID_PATH,
        f"no path {2 * radius_m:g} m wide leads{through} from ({start[0]:g}, {start[1]:g}) to ({goal[0]:g}, {goal[1]:g}){near}",
    )


def _within(radius_cells: float, solid: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Mark the cells whose center is less than a radius from a solid square."""
    if radius_cells == 0.0:
        return solid
    half_cells = 2.0 * radius_cells
    # Slightly less: a cell whose distance equals the radius is free, despite rounding.
    squares = squared_distances(solid, math.ceil(half_cells / 2.0) + 1, to_edges=True)
    return (squares < half_cells * half_cells * (1.0 - 1e-9)).view(np.uint8)
