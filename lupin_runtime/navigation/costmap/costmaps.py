"""The two costmaps: a rolling one in the odometry frame for the controller, a growing one in the map frame for the planner."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2
from lupin_runtime.gridmap import GridMap
from lupin_runtime.navigation.costmap import kernels
from lupin_runtime.navigation.costmap.costs import FREE, LETHAL, Inflation, costs_of_occupancy
from lupin_runtime.navigation.costmap.scans import BeamPoses, ObstacleLayer, RangeScan, ScanLimits

LOCAL_LIMITS = ScanLimits(mark_max_m=2.5, clear_max_m=3.0)
GLOBAL_LIMITS = ScanLimits(mark_max_m=5.0, clear_max_m=12.0)

# Cells this near are certainly the robot itself. It is less than half its width (0.157 m): a box that it touches stays marked.
SELF_RADIUS_M = 0.13


@dataclass(frozen=True)
class Costmap:
    """A snapshot: `cost` uint8 and `distance_m` float32, both (height, width), row 0 at the lowest y.

    `distance_m` is from a cell's center to the nearest lethal cell's center, exact up to the inflation's reach.
    """

    cost: NDArray[np.uint8]
    distance_m: NDArray[np.float32]
    resolution_m: float
    origin_x: float
    origin_y: float

    def cell_of(self, x: float, y: float) -> tuple[int, int]:
        """Return (row, column) of a point; it may lie outside."""
        return (
            math.floor((y - self.origin_y) / self.resolution_m),
            math.floor((x - self.origin_x) / self.resolution_m),
        )

    def contains(self, row: int, column: int) -> bool:
        """Return whether the costmap has this cell."""
        height, width = self.cost.shape
        return bool(0 <= row < height and 0 <= column < width)

    def distance_at(self, x: float, y: float) -> float:
        """Return the meters from a point's cell to the nearest lethal one; infinity outside the costmap."""
        row, column = self.cell_of(x, y)
        return float(self.distance_m[row, column]) if self.contains(row, column) else math.inf


class _Layers:
    """Static costs, obstacle evidence and inflation over one window."""

    def __init__(self, shape: tuple[int, int], resolution_m: float, inflation: Inflation, misses_to_clear: int) -> None:
        self.resolution_m = resolution_m
        self.inflation = inflation
        self.origin_x = 0.0
        self.origin_y = 0.0
        self.obstacles = ObstacleLayer(*shape, misses_to_clear=misses_to_clear)

    def geometry(self) -> NDArray[np.float64]:
        return np.array([self.origin_x, self.origin_y, self.resolution_m])

    def observe(self, scan: RangeScan, poses: BeamPoses, limits: ScanLimits) -> int:
        return self.obstacles.observe(scan, poses, limits, self.geometry())

    def clear_under_robot(self, x: float, y: float) -> None:
        self.obstacles.clear_disc(
            (y - self.origin_y) / self.resolution_m,
            (x - self.origin_x) / self.resolution_m,
            SELF_RADIUS_M / self.resolution_m,
        )

    def snapshot(self, static: NDArray[np.uint8] | None) -> Costmap:
        marked = self.obstacles.evidence > 0
        if static is None:
            base = np.where(marked, np.uint8(LETHAL), np.uint8(FREE))
        else:
            base = np.where(marked, np.uint8(LETHAL), static)
        lethal = np.ascontiguousarray(base == LETHAL).view(np.uint8)
        squares = kernels.squared_distances(lethal, self.inflation.reach_cells(self.resolution_m))
        cost_of, meters_of = self.inflation.tables(self.resolution_m)
        cost = np.empty(base.shape, np.uint8)
        distance_m = np.empty(base.shape, np.float32)
        kernels.look_up_costs(base, squares, base.size, cost_of, meters_of, cost, distance_m)
        return Costmap(cost, distance_m, self.resolution_m, self.origin_x, self.origin_y)


class LocalCostmap:
    """The obstacles around the robot: a square in the odometry frame that moves with it, by whole cells."""

    def __init__(
        self,
        size_m: float = 3.0,
        resolution_m: float = 0.05,
        inflation: Inflation | None = None,
        limits: ScanLimits = LOCAL_LIMITS,
    ) -> None:
        cells = round(size_m / resolution_m)
        self._layers = _Layers((cells, cells), resolution_m, inflation or Inflation(), misses_to_clear=3)
        self._limits = limits
        self._cells = cells
        self._anchor: tuple[int, int] | None = None

    def roll_to(self, x: float, y: float) -> None:
        """Center the window on a point of the odometry frame."""
        resolution = self._layers.resolution_m
        anchor = math.floor(y / resolution) - self._cells // 2, math.floor(x / resolution) - self._cells // 2
        if self._anchor is not None and anchor != self._anchor:
            self._layers.obstacles.shift(anchor[0] - self._anchor[0], anchor[1] - self._anchor[1])
        self._anchor = anchor
        self._layers.origin_y, self._layers.origin_x = anchor[0] * resolution, anchor[1] * resolution

    def observe(self, scan: RangeScan, poses: BeamPoses) -> int:
        """Mark and clear with a scan and the laser's poses in the odometry frame; return the number of usable beams."""
        return self._layers.observe(scan, poses, self._limits)

    def clear(self) -> None:
        """Forget all obstacles."""
        self._layers.obstacles.clear()

    def snapshot(self, robot: Pose2) -> Costmap:
        """Return the inflated costmap, without obstacles under the robot."""
        self._layers.clear_under_robot(robot.x, robot.y)
        return self._layers.snapshot(None)


class GlobalCostmap:
    """The map, obstacles that only the lidar saw, and the inflation around both; it grows with the map.

    Marks fade after `memory_updates` updates without a new hit: static obstacles are in the map by then, and a mark that a
    pose correction has put beside the true wall must not narrow an aisle forever.
    """

    def __init__(
        self, inflation: Inflation | None = None, limits: ScanLimits = GLOBAL_LIMITS, memory_updates: int = 30
    ) -> None:
        self._inflation = inflation or Inflation()
        self._limits = limits
        self._layers: _Layers | None = None
        self._static: NDArray[np.uint8] | None = None
        self._fade = max(1, ObstacleLayer.HIT // memory_updates)

    @property
    def ready(self) -> bool:
        """Whether a map was set."""
        return self._static is not None

    def set_map(self, grid: GridMap) -> None:
        """Set a new map; obstacles keep their positions when its size or origin changes."""
        self._static = costs_of_occupancy(grid.cells)
        layers = self._layers
        if layers is None or layers.resolution_m != grid.resolution_m:
            layers = self._layers = _Layers(self._static.shape, grid.resolution_m, self._inflation, misses_to_clear=2)
        elif (layers.origin_x, layers.origin_y) != (grid.origin_x, grid.origin_y) or (
            layers.obstacles.evidence.shape != self._static.shape
        ):
            layers.obstacles.reshape(
                round((grid.origin_y - layers.origin_y) / grid.resolution_m),
                round((grid.origin_x - layers.origin_x) / grid.resolution_m),
                self._static.shape,
            )
        layers.origin_x, layers.origin_y = grid.origin_x, grid.origin_y

    def observe(self, scan: RangeScan, poses: BeamPoses) -> int:
        """Mark and clear with a scan and the laser's poses in the map frame; return the number of usable beams, 0 if no map."""
        if self._layers is None:
            return 0
        self._layers.obstacles.age(self._fade)
        return self._layers.observe(scan, poses, self._limits)

    def clear(self) -> None:
        """Forget all obstacles that are not in the map."""
        if self._layers is not None:
            self._layers.obstacles.clear()

    def snapshot(self, robot: Pose2 | None) -> Costmap:
        """Return the inflated costmap. Raises LookupError before the first map."""
        if self._layers is None or self._static is None:
            raise LookupError("no map has arrived yet")
        if robot is not None:
            self._layers.clear_under_robot(robot.x, robot.y)
        return self._layers.snapshot(self._static)
