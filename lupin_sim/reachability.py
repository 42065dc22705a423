"""Computes which places of a world the robot can reach: cells with enough clearance, connected to the start."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from lupin_sim import mirte
from lupin_sim.world import Box, World

CELL_M = 0.05
# The distance that a planner keeps from obstacles: the robot's circle and a margin for map errors.
ROBOT_RADIUS_M = mirte.OUTER_RADIUS_M + 0.03
STANDOFF_M = 0.5


class FreeSpace:
    """The cells of a world where a circle of `radius_m` fits (`free`), and those connected to the start (`reachable`)."""

    def __init__(self, world: World, radius_m: float = ROBOT_RADIUS_M) -> None:
        x0, y0, x1, y1 = world.bounds
        self._origin = (x0, y0)
        columns, rows = max(1, math.ceil((x1 - x0) / CELL_M)), max(1, math.ceil((y1 - y0) / CELL_M))
        xs = x0 + (np.arange(columns) + 0.5) * CELL_M
        ys = y0 + (np.arange(rows) + 0.5) * CELL_M
        x, y = np.meshgrid(xs, ys)
        clearance = np.minimum(np.minimum(x - x0, x1 - x), np.minimum(y - y0, y1 - y))
        for box in world.boxes:
            clearance = np.minimum(clearance, _distance(box, x, y))
        for pillar in world.pillars:
            clearance = np.minimum(clearance, np.hypot(x - pillar.x, y - pillar.y) - pillar.radius)
        self.free: NDArray[np.bool_] = clearance >= radius_m
        # OpenCV is loaded in this process anyway; SciPy only for this would add 20 MB.
        _, labels = cv2.connectedComponents(self.free.astype(np.uint8), connectivity=4)
        start_label = self._label_at(labels, world.start.x, world.start.y)
        self.reachable: NDArray[np.bool_] = (labels == start_label) & self.free if start_label else np.zeros_like(self.free)

    def reaches(self, x: float, y: float) -> bool:
        """Return whether the robot can drive from the start to a point."""
        row, column = self._cell(x, y)
        inside = 0 <= row < self.reachable.shape[0] and 0 <= column < self.reachable.shape[1]
        return inside and bool(self.reachable[row, column])

    def _cell(self, x: float, y: float) -> tuple[int, int]:
        return math.floor((y - self._origin[1]) / CELL_M), math.floor((x - self._origin[0]) / CELL_M)

    def _label_at(self, labels: NDArray[np.int32], x: float, y: float) -> int:
        row, column = self._cell(x, y)
        if 0 <= row < labels.shape[0] and 0 <= column < labels.shape[1]:
            return int(labels[row, column])
        return 0


def _distance(box: Box, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    c, s = math.cos(box.yaw), math.sin(box.yaw)
    u, v = c * (x - box.x) + s * (y - box.y), -s * (x - box.x) + c * (y - box.y)
    outside_u = np.maximum(np.abs(u) - box.depth / 2, 0.0)
    outside_v = np.maximum(np.abs(v) - box.width / 2, 0.0)
    return np.asarray(np.hypot(outside_u, outside_v))


def reachable_tags(world: World, radius_m: float = ROBOT_RADIUS_M, standoff_m: float = STANDOFF_M) -> frozenset[int]:
    """Return the ids of the tags for which the robot can drive from the start to a point `standoff_m` in front of the plate."""
    space = FreeSpace(world, radius_m)
    found = set()
    for tag in world.tags:
        x, y = tag.pose.apply(standoff_m, 0.0)
        if space.reaches(x, y):
            found.add(tag.id)
    return frozenset(found)
