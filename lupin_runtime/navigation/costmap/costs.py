"""Costs of cells: Nav2's constants, its inflation formula, and the translation to an OccupancyGrid."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

# Nav2's nav2_costmap_2d/cost_values.hpp: other nodes rely on these numbers.
FREE = 0
INSCRIBED = 253
LETHAL = 254
UNKNOWN = 255

# map_server's default occupied_thresh: for a SLAM that publishes probabilities, the threshold of a wall.
OCCUPIED_PERCENT = 65


@dataclass(frozen=True)
class Inflation:
    """How cost falls off around an obstacle.

    Distances are exact up to `reach_m`; larger ones are given as `reach_m` plus a cell. `reach_m` is larger than `radius_m`,
    since the planner and the controller use meters, not costs.
    """

    robot_radius_m: float = 0.22
    radius_m: float = 0.25
    scaling: float = 5.0
    reach_m: float = 0.7

    def cost(self, distance_m: float) -> int:
        """Return the cost at a distance from the nearest lethal cell's center.

        254 at it, 253 within the robot's radius, then 252 exp(-scaling (d - robot radius)) up to `radius_m`, as in Nav2.
        """
        if distance_m <= 0.0:
            return LETHAL
        if distance_m <= self.robot_radius_m:
            return INSCRIBED
        if distance_m > self.radius_m:
            return FREE
        return int((INSCRIBED - 1) * math.exp(-self.scaling * (distance_m - self.robot_radius_m)))

    def reach_cells(self, resolution_m: float) -> int:
        """Return the reach in whole cells: the largest of `reach_m` and the two radii."""
        return max(1, math.ceil(max(self.reach_m, self.radius_m, self.robot_radius_m) / resolution_m))

    def tables(self, resolution_m: float) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Return the cost and the meters of every squared distance in cells, up to the reach and one cell beyond."""
        return _tables(self, resolution_m)


@lru_cache(maxsize=8)
def _tables(inflation: Inflation, resolution_m: float) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    size = (inflation.reach_cells(resolution_m) + 1) ** 2 + 1
    meters = np.sqrt(np.arange(size, dtype=np.float64)) * resolution_m
    cost = np.array([inflation.cost(float(d)) for d in meters], dtype=np.uint8)
    return cost, meters.astype(np.float32)


def _occupancy_table() -> NDArray[np.int8]:
    table = np.empty(256, np.int8)
    table[FREE] = 0
    table[INSCRIBED] = 99
    table[LETHAL] = 100
    table[UNKNOWN] = -1
    # Nav2's costmap_2d_publisher: the open range maps onto 1..98.
    for cost in range(1, INSCRIBED):
        table[cost] = 1 + (97 * (cost - 1)) // 251
    return table


OCCUPANCY_OF_COST = _occupancy_table()


def costs_of_occupancy(cells: NDArray[np.int8]) -> NDArray[np.uint8]:
    """Return the static costs of an OccupancyGrid's cells: unknown, lethal from OCCUPIED_PERCENT on, else free."""
    return np.where(cells < 0, UNKNOWN, np.where(cells >= OCCUPIED_PERCENT, LETHAL, FREE)).astype(np.uint8)
