"""Camera flights for films: poses of a drive past every reachable tag, or along a trajectory. No physics, no sensors."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from lupin_runtime.geometry import Pose2, wrap_angle
from lupin_sim import mirte
from lupin_sim.reachability import CELL_M, ROBOT_RADIUS_M, STANDOFF_M, FreeSpace
from lupin_sim.world import World

SPEED_MPS = 0.45
TURN_RADPS = 1.2
INSPECTION_S = 2.0
HOME = mirte.ARM_START_RAD
# This pose shows the flowers of a planter from half a meter in front of its tag.
INSPECT = (0.0, 0.60, -0.80, -1.47)
DRIVING_LED, INSPECTING_LED = (0, 255, 128), (180, 0, 255)


@dataclass(frozen=True)
class FilmFrame:
    """One frame of a film: pose of the robot, joint angles of its arm (rad), color of its LED strip (0..255 each)."""

    time_s: float
    pose: Pose2
    arm: tuple[float, ...] = HOME
    leds: tuple[int, int, int] = DRIVING_LED


def from_trajectory(trajectory: NDArray[np.float64], rate_hz: float) -> list[FilmFrame]:
    """Frames along a recorded trajectory of shape (n, 8), in TUM order and the world frame."""
    t = trajectory[:, 0]
    yaw = np.unwrap(2.0 * np.arctan2(trajectory[:, 6], trajectory[:, 7]))
    times = np.arange(t[0], t[-1] + 1e-9, 1.0 / rate_hz)
    columns = [np.interp(times, t, values) for values in (trajectory[:, 1], trajectory[:, 2], yaw)]
    return [
        FilmFrame(float(at - t[0]), Pose2(float(x), float(y), wrap_angle(float(a)))) for at, x, y, a in zip(times, *columns)
    ]


def flythrough(world: World, rate_hz: float) -> list[FilmFrame]:
    """Frames of a drive to every reachable tag, always the nearest next, with an inspection of its flowers, and back."""
    routes = _Routes(world)
    position = world.start
    frames: list[FilmFrame] = [FilmFrame(0.0, position)]
    remaining = {tag.id: tag for tag in world.tags if routes.reaches(*tag.pose.apply(STANDOFF_M, 0.0))}
    while remaining:
        paths = {i: routes.path(position, tag.pose.apply(STANDOFF_M, 0.0)) for i, tag in remaining.items()}
        tag = remaining.pop(min(paths, key=lambda i: (_length(paths[i]), i)))
        goal = Pose2(*tag.pose.apply(STANDOFF_M, 0.0), wrap_angle(tag.yaw + math.pi))
        frames += _drive(frames[-1], paths[tag.id], goal, rate_hz)
        frames += _inspect(frames[-1], rate_hz)
        position = goal
    frames += _drive(frames[-1], routes.path(position, (world.start.x, world.start.y)), world.start, rate_hz)
    return frames


class _Routes:
    """Shortest paths over the free cells of a world; cells near obstacles cost more."""

    def __init__(self, world: World) -> None:
        self._space = FreeSpace(world, ROBOT_RADIUS_M)
        self._origin = world.bounds[:2]
        free = self._space.reachable
        self._index = np.full(free.shape, -1)
        self._index[free] = np.arange(int(free.sum()))
        self._cells = np.argwhere(free)
        distance = ndimage.distance_transform_edt(free) * CELL_M
        cell_cost = 1.0 + 1.5 * np.exp(-distance / 0.2)
        rows, columns, weights = [], [], []
        for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1)):
            cells, neighbors = self._cells, self._cells + np.array((dr, dc))
            inside = (neighbors >= 0).all(1) & (neighbors < free.shape).all(1)
            cells, neighbors = cells[inside], neighbors[inside]
            a, b = self._index[tuple(cells.T)], self._index[tuple(neighbors.T)]
            connected = b >= 0
            rows.append(a[connected])
            columns.append(b[connected])
            cost = (cell_cost[tuple(cells.T)] + cell_cost[tuple(neighbors.T)]) / 2 * math.hypot(dr, dc) * CELL_M
            weights.append(cost[connected])
        n = len(self._cells)
        self._graph = coo_matrix((np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns))), (n, n)).tocsr()

    def reaches(self, x: float, y: float) -> bool:
        return self._space.reaches(x, y)

    def path(self, start: Pose2, goal: tuple[float, float]) -> NDArray[np.float64]:
        """Points of shape (n, 2) from start to goal, smoothed."""
        a, b = self._node(start.x, start.y), self._node(*goal)
        _, before = dijkstra(self._graph, directed=False, indices=b, return_predecessors=True)
        nodes = [a]
        while nodes[-1] != b and before[nodes[-1]] >= 0:
            nodes.append(int(before[nodes[-1]]))
        cells = self._cells[nodes][:, ::-1]
        points = np.vstack([(start.x, start.y), (cells + 0.5) * CELL_M + self._origin, goal])
        return np.asarray(ndimage.gaussian_filter1d(points, 4.0, axis=0, mode="nearest"))

    def _node(self, x: float, y: float) -> int:
        column, row = (math.floor((v - o) / CELL_M) for v, o in zip((x, y), self._origin))
        return int(self._index[row, column])


def _length(points: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def _drive(last: FilmFrame, points: NDArray[np.float64], goal: Pose2, rate_hz: float) -> list[FilmFrame]:
    distances = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    frames: list[FilmFrame] = []
    yaw, time_s, step = last.pose.yaw, last.time_s, 1.0 / rate_hz
    driven = 0.0
    while driven < distances[-1] or abs(wrap_angle(goal.yaw - yaw)) > 1e-3:
        ahead = min(driven + 0.3, float(distances[-1]))
        x, y = (float(np.interp(driven, distances, points[:, axis])) for axis in (0, 1))
        ax, ay = (float(np.interp(ahead, distances, points[:, axis])) for axis in (0, 1))
        rest = float(distances[-1]) - driven
        heading = goal.yaw if rest < 0.5 else math.atan2(ay - y, ax - x)
        error = wrap_angle(heading - yaw)
        yaw += min(max(error, -TURN_RADPS * step), TURN_RADPS * step)
        # Slower in turns and towards the end.
        driven = min(float(distances[-1]), driven + SPEED_MPS * step * max(0.15, math.cos(error)) * min(1.0, 0.25 + rest))
        time_s += step
        frames.append(FilmFrame(time_s, Pose2(x, y, wrap_angle(yaw))))
    return frames


def _inspect(last: FilmFrame, rate_hz: float) -> list[FilmFrame]:
    frames = []
    moments = round(INSPECTION_S * rate_hz)
    for index in range(moments):
        # The arm moves down in the first quarter and up in the last.
        phase = index / moments
        f = min(1.0, phase * 4, (1.0 - phase) * 4)
        arm = tuple(a + f * (b - a) for a, b in zip(HOME, INSPECT))
        frames.append(FilmFrame(last.time_s + (index + 1) / rate_hz, last.pose, arm, INSPECTING_LED))
    return frames
