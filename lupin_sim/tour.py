"""A drive past every reachable tag, made up for films: no physics, no sensors, just poses over time."""

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
from lupin_sim.reach import CELL_M, ROBOT_RADIUS_M, STANDOFF_M, FreeSpace
from lupin_sim.world import World

SPEED_MPS = 0.45
TURN_RADPS = 1.2
LOOK_S = 2.0
HOME = mirte.ARM_START_RAD
# Frames the blooms of a planter from half a metre in front of its tag.
INSPECT = (0.0, 0.60, -0.80, -1.47)
DRIVING_LED, LOOKING_LED = (0, 255, 128), (180, 0, 255)


@dataclass(frozen=True)
class Frame:
    """One moment of a film: where the robot is, its arm's joints, its strip's colour (0..255 each)."""

    time_s: float
    pose: Pose2
    arm: tuple[float, ...] = HOME
    leds: tuple[int, int, int] = DRIVING_LED


def from_trajectory(trajectory: NDArray[np.float64], rate_hz: float) -> list[Frame]:
    """Frames along a recorded trajectory, shape (n, 8) in TUM order, in the world frame."""
    t = trajectory[:, 0]
    yaw = np.unwrap(2.0 * np.arctan2(trajectory[:, 6], trajectory[:, 7]))
    times = np.arange(t[0], t[-1] + 1e-9, 1.0 / rate_hz)
    columns = [np.interp(times, t, values) for values in (trajectory[:, 1], trajectory[:, 2], yaw)]
    return [Frame(float(at - t[0]), Pose2(float(x), float(y), wrap_angle(float(a)))) for at, x, y, a in zip(times, *columns)]


def tour(world: World, rate_hz: float) -> list[Frame]:
    """Frames of a drive to every tag that can be reached, nearest next, with a look at its flowers, and back."""
    routes = _Routes(world)
    at = world.start
    frames: list[Frame] = [Frame(0.0, at)]
    todo = {tag.id: tag for tag in world.tags if routes.reaches(*tag.pose.apply(STANDOFF_M, 0.0))}
    while todo:
        way = {i: routes.path(at, tag.pose.apply(STANDOFF_M, 0.0)) for i, tag in todo.items()}
        tag = todo.pop(min(way, key=lambda i: (_length(way[i]), i)))
        goal = Pose2(*tag.pose.apply(STANDOFF_M, 0.0), wrap_angle(tag.yaw + math.pi))
        frames += _drive(frames[-1], way[tag.id], goal, rate_hz)
        frames += _look(frames[-1], rate_hz)
        at = goal
    frames += _drive(frames[-1], routes.path(at, (world.start.x, world.start.y)), world.start, rate_hz)
    return frames


class _Routes:
    """Shortest ways over the free cells of a world, keeping a little more distance where there is room."""

    def __init__(self, world: World) -> None:
        self._space = FreeSpace(world, ROBOT_RADIUS_M)
        self._origin = world.bounds[:2]
        free = self._space.reachable
        self._index = np.full(free.shape, -1)
        self._index[free] = np.arange(int(free.sum()))
        self._cells = np.argwhere(free)
        distance = ndimage.distance_transform_edt(free) * CELL_M
        price = 1.0 + 1.5 * np.exp(-distance / 0.2)
        rows, columns, weights = [], [], []
        for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1)):
            here, there = self._cells, self._cells + np.array((dr, dc))
            inside = (there >= 0).all(1) & (there < free.shape).all(1)
            here, there = here[inside], there[inside]
            a, b = self._index[tuple(here.T)], self._index[tuple(there.T)]
            both = b >= 0
            rows.append(a[both])
            columns.append(b[both])
            cost = (price[tuple(here.T)] + price[tuple(there.T)]) / 2 * math.hypot(dr, dc) * CELL_M
            weights.append(cost[both])
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


def _drive(last: Frame, points: NDArray[np.float64], goal: Pose2, rate_hz: float) -> list[Frame]:
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    frames: list[Frame] = []
    yaw, time_s, step = last.pose.yaw, last.time_s, 1.0 / rate_hz
    gone = 0.0
    while gone < way[-1] or abs(wrap_angle(goal.yaw - yaw)) > 1e-3:
        ahead = min(gone + 0.3, float(way[-1]))
        x, y = (float(np.interp(gone, way, points[:, axis])) for axis in (0, 1))
        ax, ay = (float(np.interp(ahead, way, points[:, axis])) for axis in (0, 1))
        left = float(way[-1]) - gone
        heading = goal.yaw if left < 0.5 else math.atan2(ay - y, ax - x)
        error = wrap_angle(heading - yaw)
        yaw += min(max(error, -TURN_RADPS * step), TURN_RADPS * step)
        # Slower where it has to turn, and towards the end.
        gone = min(float(way[-1]), gone + SPEED_MPS * step * max(0.15, math.cos(error)) * min(1.0, 0.25 + left))
        time_s += step
        frames.append(Frame(time_s, Pose2(x, y, wrap_angle(yaw))))
    return frames


def _look(last: Frame, rate_hz: float) -> list[Frame]:
    frames = []
    moments = round(LOOK_S * rate_hz)
    for index in range(moments):
        # Down in the first quarter, up in the last.
        phase = index / moments
        f = min(1.0, phase * 4, (1.0 - phase) * 4)
        arm = tuple(a + f * (b - a) for a, b in zip(HOME, INSPECT))
        frames.append(Frame(last.time_s + (index + 1) / rate_hz, last.pose, arm, LOOKING_LED))
    return frames
