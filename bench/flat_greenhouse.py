"""A whole mission in seconds: the orchestrator's core in a simulated greenhouse without physics, pictures or ROS.

The robot is a point that follows shortest roads at a constant speed, its lidar fills a map once a second, its camera finds the
tags that a detector would. What it measures is where the mission drives and how long it takes, in simulated time.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2, wrap_angle
from lupin_runtime.gridmap import GridMap
from lupin_runtime.mission.approach import Clearance, TagPose
from lupin_runtime.mission.config import MissionConfig
from lupin_runtime.mission.coverage import travel_distances
from lupin_runtime.mission.orchestrator import Orchestrator
from lupin_runtime.mission.ports import Confirmation, ObservationRecord, Ports, Reading
from lupin_sim.reach import reachable_tags
from lupin_sim.world import World
from lupin_sim.worlds import load_world

CELL_M = 0.05
SPEED_M_S, TURN_RAD_S = 0.35, 1.0
STEP_S = 0.1
LIDAR_M, BEAMS = 12.0, 720
TAG_SEEN_M, TAG_INCIDENCE_RAD, HALF_FOV_RAD, SIGHTINGS = 2.0, math.radians(60.0), math.radians(29.0), 3
CAMERA_X_M = 0.147
ROBOT_ROOM_M = 0.24


def _standing(yaw: float) -> tuple[float, float, float, float]:
    """The orientation of a tag on a wall whose normal has this heading."""
    half, s = yaw / 2.0, math.sqrt(0.5)
    return -math.sin(half) * s, math.cos(half) * s, math.sin(half) * s, math.cos(half) * s


class FlatGreenhouse:
    """The ports of an orchestrator, and the world behind them."""

    def __init__(self, world: World, range_sigma_m: float = 0.0, pose_sigma_m: float = 0.0, **parameters: Any) -> None:
        self.world = world
        self._rng = np.random.default_rng(world.seed)
        self._range_sigma_m, self._pose_sigma_m = range_sigma_m, pose_sigma_m
        x0, y0, x1, y1 = world.bounds
        margin = 0.5
        self._origin = (x0 - margin, y0 - margin)
        shape = (math.ceil((y1 - y0 + 2 * margin) / CELL_M), math.ceil((x1 - x0 + 2 * margin) / CELL_M))
        ys, xs = np.mgrid[0 : shape[0], 0 : shape[1]]
        x, y = self._origin[0] + (xs + 0.5) * CELL_M, self._origin[1] + (ys + 0.5) * CELL_M
        self.solid: NDArray[np.bool_] = ~((x > x0) & (x < x1) & (y > y0) & (y < y1))
        for box in world.boxes:
            c, s = math.cos(box.yaw), math.sin(box.yaw)
            u, v = c * (x - box.x) + s * (y - box.y), -s * (x - box.x) + c * (y - box.y)
            self.solid |= (np.abs(u) <= box.depth / 2) & (np.abs(v) <= box.width / 2)
        for pillar in world.pillars:
            self.solid |= np.hypot(x - pillar.x, y - pillar.y) <= pillar.radius
        self._odds = np.full(shape, np.nan)  # log odds of being occupied; not a number: never touched
        self.pose = world.start
        self.now = 1.0
        self.length_m = 0.0
        self.records: list[ObservationRecord] = []
        self.log_lines: list[str] = []
        self._sightings: Counter[int] = Counter()
        self._goal: tuple[int, Pose2, list[tuple[float, float]] | None] | None = None
        self._later: list[tuple[float, Callable[[], None]]] = []
        self._map: tuple[int, GridMap] | None = None
        self.orchestrator = Orchestrator(
            MissionConfig.from_parameters({"exploration_timeout_s": 1800.0, "monitoring_sweeps": 1, **parameters}),
            Ports(self, self, self, self, self, self, self),
        )

    # -- ports

    def now_s(self) -> float:
        return self.now

    def stamp_ns(self) -> int:
        return int(self.now * 1e9)

    def is_ready(self) -> bool:
        return True

    def _soon(self, act: Callable[[], None], after_s: float = 0.05) -> None:
        self._later.append((self.now + after_s, act))

    def send(self, token: int, pose: Pose2) -> None:
        self._goal = (token, pose, None)
        self._soon(lambda: self.orchestrator.goal_accepted(token))

    def cancel(self, token: int) -> None:
        if self._goal is not None and self._goal[0] == token:
            self._goal = None
            self._soon(lambda: self.orchestrator.goal_finished(token, 5))

    def cancel_all(self) -> None:
        self._goal = None

    def read(self, tag_id: str, done: Callable[[Reading], None]) -> None:
        self._soon(lambda: done(Reading(0, values=(("co2", 400.0),))))

    def confirm(self, tag_id: str, done: Callable[[Confirmation], None]) -> None:
        self._soon(lambda: done(Confirmation(True)))

    def strike(self, preset: str) -> bool:
        return True

    def robot_pose(self) -> Pose2:
        dx, dy, dyaw = self._rng.normal(0.0, self._pose_sigma_m, 3)
        return Pose2(self.pose.x + dx, self.pose.y + dy, self.pose.yaw + dyaw)

    @property
    def known(self) -> NDArray[np.int8]:
        """The map that the lidar has made so far."""
        touched = np.where(self._odds > 0.0, 100, 0)
        return np.where(np.isnan(self._odds), -1, touched).astype(np.int8)

    def map(self) -> tuple[int, GridMap] | None:
        return self._map

    def observe(self, record: ObservationRecord) -> None:
        self.records.append(record)

    def changed(self) -> None:
        pass

    def log(self, text: str, warning: bool = False) -> None:
        self.log_lines.append(f"{self.now:7.1f} {text}")

    # -- the world

    def step(self) -> None:
        """A tenth of a second."""
        self.now += STEP_S
        due = [act for at, act in self._later if at <= self.now]
        self._later = [(at, act) for at, act in self._later if at > self.now]
        for act in due:
            act()
        self._drive()
        self._look()
        ticks = round(self.now / STEP_S)
        if ticks % 10 == 0:
            self._scan(ticks // 10)
        if ticks % 5 == 0:
            found = {tag.id: tag for tag in self.world.tags if self._sightings[tag.id] >= SIGHTINGS}
            self.orchestrator.heard_tags(
                {str(i): TagPose(tag.x, tag.y, tag.z, *_standing(tag.yaw)) for i, tag in found.items()}
            )
            self.orchestrator.heard_pose(TagPose(self.pose.x, self.pose.y), (0.01, 0.01, 0.01))
        self.orchestrator.tick()

    def _grid(self, cells: NDArray[np.int8]) -> GridMap:
        return GridMap(cells, CELL_M, *self._origin)

    def _drive(self) -> None:
        if self._goal is None:
            return
        token, goal, road = self._goal
        if road is None:
            road = self._plan(goal)
            if road is None:
                self._goal = None
                self._soon(lambda: self.orchestrator.goal_finished(token, 6), 1.0)
                return
            self._goal = (token, goal, road)
        left = SPEED_M_S * STEP_S
        while road and left > 0.0:
            dx, dy = road[0][0] - self.pose.x, road[0][1] - self.pose.y
            distance = math.hypot(dx, dy)
            move = min(left, distance)
            if distance > 1e-9:
                heading = self._turned(math.atan2(dy, dx))
                self.pose = Pose2(self.pose.x + dx / distance * move, self.pose.y + dy / distance * move, heading)
            self.length_m += move
            left -= move
            if move >= distance:
                road.pop(0)
        if not road:
            self.pose = Pose2(self.pose.x, self.pose.y, self._turned(goal.yaw))
            if abs(wrap_angle(self.pose.yaw - goal.yaw)) < 0.12:
                self._goal = None
                self._soon(lambda: self.orchestrator.goal_finished(token, 4))

    def _turned(self, towards: float) -> float:
        turn = wrap_angle(towards - self.pose.yaw)
        most = TURN_RAD_S * STEP_S
        return wrap_angle(self.pose.yaw + max(-most, min(most, turn)))

    def _plan(self, goal: Pose2) -> list[tuple[float, float]] | None:
        """A road over what is not known to be blocked, as a planner that may cross the unknown finds it."""
        known = self.known
        cells = np.where(known >= 65, known, 0).astype(np.int8)
        clearance = Clearance.of(self._grid(cells))
        distance = travel_distances(clearance, goal, ROBOT_ROOM_M)
        if distance is None:
            return None
        row, column = self._grid(cells).cell_of(self.pose.x, self.pose.y)
        r0, c0 = max(0, row - 8), max(0, column - 8)
        near = distance[r0 : row + 9, c0 : column + 9]
        if near.size == 0 or not np.isfinite(near.min()):
            return None
        if not np.isfinite(distance[row, column]):  # too near to something: to the next cell that is not
            ok = np.argwhere(np.isfinite(near))
            nearest = ok[np.argmin(np.hypot(ok[:, 0] + r0 - row, ok[:, 1] + c0 - column))]
            row, column = int(nearest[0]) + r0, int(nearest[1]) + c0
        road = []
        while distance[row, column] > CELL_M:
            window = distance[row - 1 : row + 2, column - 1 : column + 2]
            dr, dc = np.unravel_index(np.argmin(window), window.shape)
            if (dr, dc) == (1, 1):
                break
            row, column = row + int(dr) - 1, column + int(dc) - 1
            road.append(self._grid(cells).centre_of(row, column))
        end = road[-1] if road else (self.pose.x, self.pose.y)
        if math.hypot(end[0] - goal.x, end[1] - goal.y) > 0.3:
            return None
        return [*road[::3], end]

    def _ray(self, x: float, y: float, angles: NDArray[np.float64], reach: float) -> tuple[Any, Any, Any]:
        """Cells along rays (n, k), and the index of the first solid one (k where none is)."""
        steps = np.arange(1, int(reach / (CELL_M / 2)) + 1) * (CELL_M / 2)
        columns = np.floor((x + np.outer(np.cos(angles), steps) - self._origin[0]) / CELL_M).astype(int)
        rows = np.floor((y + np.outer(np.sin(angles), steps) - self._origin[1]) / CELL_M).astype(int)
        np.clip(rows, 0, self.solid.shape[0] - 1, out=rows)
        np.clip(columns, 0, self.solid.shape[1] - 1, out=columns)
        hit = self.solid[rows, columns]
        return rows, columns, np.where(hit.any(axis=1), hit.argmax(axis=1), len(steps))

    def _scan(self, number: int) -> None:
        angles = np.linspace(-math.pi, math.pi, BEAMS, endpoint=False)
        seen_from = self.robot_pose()
        rows, columns, first = self._ray(self.pose.x, self.pose.y, angles, LIDAR_M)
        hits = np.flatnonzero(first < rows.shape[1])
        noise = np.round(self._rng.normal(0.0, self._range_sigma_m, len(first)) / (CELL_M / 2)).astype(int)
        ends = np.clip(first + noise, 0, rows.shape[1] - 1)
        by = round((seen_from.y - self.pose.y) / CELL_M), round((seen_from.x - self.pose.x) / CELL_M)
        rows, columns = np.clip(rows + by[0], 0, self.solid.shape[0] - 1), np.clip(columns + by[1], 0, self.solid.shape[1] - 1)
        # The cell of the hit is not passed, whichever of its half-cell steps the beam ends in.
        hit_rows, hit_columns = rows[hits, ends[hits]], columns[hits, ends[hits]]
        passed = np.zeros(self.solid.shape, bool)
        free = np.arange(rows.shape[1])[None, :] < ends[:, None]
        passed[rows[free], columns[free]] = True
        touched = np.zeros(self.solid.shape, bool)
        touched[hit_rows, hit_columns] = True
        passed &= ~touched
        self._odds[np.isnan(self._odds) & (passed | touched)] = 0.0
        self._odds[passed] = np.maximum(self._odds[passed] - 0.4, -4.0)
        self._odds[touched] = np.minimum(self._odds[touched] + 0.9, 4.0)
        self._map = (number, self._grid(self.known))

    def _look(self) -> None:
        x, y = self.pose.apply(CAMERA_X_M, 0.0)
        for tag in self.world.tags:
            dx, dy = tag.x - x, tag.y - y
            distance = math.hypot(dx, dy)
            if distance > TAG_SEEN_M or abs(wrap_angle(math.atan2(dy, dx) - self.pose.yaw)) > HALF_FOV_RAD:
                continue
            if abs(wrap_angle(math.atan2(-dy, -dx) - tag.yaw)) > TAG_INCIDENCE_RAD:
                continue
            _, _, first = self._ray(x, y, np.array([math.atan2(dy, dx)]), max(0.1, distance - 0.1))
            if first[0] * CELL_M / 2 >= distance - 0.15:
                self._sightings[tag.id] += 1


@dataclass
class Result:
    """How a mission went."""

    world: str
    state: str
    reachable: int
    found: int
    read: int
    missed: list[int] = field(default_factory=list)
    exploration_s: float = 0.0
    mission_s: float = 0.0
    length_m: float = 0.0
    goals: int = 0


def explore(
    name: str, limit_s: float = 3600.0, range_sigma_m: float = 0.0, pose_sigma_m: float = 0.0, **parameters: Any
) -> tuple[Result, FlatGreenhouse]:
    """A mission for all tags in a world of the simulator."""
    world = load_world(name)
    house = FlatGreenhouse(world, range_sigma_m, pose_sigma_m, **parameters)
    while house.orchestrator.hsm.lifecycle != "READY":
        house.step()
    for _ in range(20):
        house.step()
    reply = house.orchestrator.start("ExplorationMission", (), 65535)
    if not reply.success:
        raise RuntimeError(reply.message)
    began = house.now
    explored = None
    while house.orchestrator.hsm.lifecycle not in ("DONE", "FAULT") and house.now - began < limit_s:
        house.step()
        if explored is None and house.orchestrator.hsm.lifecycle not in ("PREPARE", "EXPLORING"):
            explored = house.now - began
    reachable = reachable_tags(world)
    found = {int(tag) for tag in house.orchestrator._context.beliefs.discovered}
    read = {int(r.tag_id) for r in house.records if r.status == 0 and r.source == "MonitoringMission"}
    return (
        Result(
            name,
            house.orchestrator.hsm.lifecycle,
            len(reachable),
            len(found),
            len(read & reachable),
            sorted(reachable - read),
            explored or 0.0,
            house.now - began,
            house.length_m,
            sum(" to (" in line for line in house.log_lines),
        ),
        house,
    )
