"""Runs a complete mission in seconds: the orchestrator in a simulated greenhouse without physics, images or ROS.

The robot is a point that follows shortest paths at constant speed. Its lidar updates a map once a second, and its camera
detects the tags that the real detector would detect. All times are simulated.
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
from lupin_runtime.mission.clearance import ClearanceMap
from lupin_runtime.mission.config import MissionConfig
from lupin_runtime.mission.kernels import travel_distances
from lupin_runtime.mission.orchestrator import Orchestrator
from lupin_runtime.mission.ports import Ports
from lupin_runtime.mission.records import ClimateReading, Confirmation, MapPose, ObservationRecord
from lupin_sim.reachability import reachable_tags
from lupin_sim.world import World
from lupin_sim.worlds import load_world
from tests.support.mission_rig import tag_orientation

CELL_M = 0.05
SPEED_M_S, TURN_RAD_S = 0.35, 1.0
STEP_S = 0.1
LIDAR_RANGE_M, BEAMS = 12.0, 720
TAG_RANGE_M, TAG_INCIDENCE_RAD, HALF_FOV_RAD, SIGHTINGS = 2.0, math.radians(60.0), math.radians(29.0), 3
CAMERA_X_M = 0.147
ROBOT_CLEARANCE_M = 0.24


class MissionSimulator:
    """An orchestrator, all of its ports, and the world behind them.

    `range_sigma_m` is the noise of lidar ranges, `pose_sigma_m` the noise of the estimated pose, in meters and radians.
    Further keyword arguments are parameters of MissionConfig.
    """

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
        self._odds = np.full(shape, np.nan)  # log odds of being occupied; NaN: never observed
        self.pose = world.start
        self.now = 1.0
        self.driven_m = 0.0
        self.records: list[ObservationRecord] = []
        self.log_lines: list[str] = []
        self._sightings: Counter[int] = Counter()
        self._goal: tuple[int, Pose2, list[tuple[float, float]] | None] | None = None
        self._scheduled: list[tuple[float, Callable[[], None]]] = []
        self._map: tuple[int, GridMap] | None = None
        self.orchestrator = Orchestrator(
            MissionConfig.from_parameters({"exploration_timeout_s": 1800.0, "monitoring_sweeps": 1, **parameters}),
            Ports(self, self, self, self, self, self, self),
        )

    # -- ports

    def now_s(self) -> float:
        return self.now

    def monotonic_s(self) -> float:
        return self.now

    def stamp_ns(self) -> int:
        return int(self.now * 1e9)

    def is_ready(self) -> bool:
        return True

    def _schedule(self, act: Callable[[], None], after_s: float = 0.05) -> None:
        self._scheduled.append((self.now + after_s, act))

    def send(self, token: int, pose: Pose2) -> None:
        self._goal = (token, pose, None)
        self._schedule(lambda: self.orchestrator.goal_accepted(token))

    def cancel(self, token: int) -> None:
        if self._goal is not None and self._goal[0] == token:
            self._goal = None
            self._schedule(lambda: self.orchestrator.goal_finished(token, 5))

    def cancel_all(self, on_answer: Callable[[], None]) -> bool:
        self._goal = None
        on_answer()
        return True

    def read(self, tag_id: str, on_reading: Callable[[ClimateReading], None]) -> None:
        self._schedule(lambda: on_reading(ClimateReading(0, values=(("co2", 400.0),))))

    def confirm(self, tag_id: str, on_confirmation: Callable[[Confirmation], None]) -> None:
        self._schedule(lambda: on_confirmation(Confirmation(True)))

    def move_to_preset(self, preset: str) -> bool:
        return True

    def robot_pose(self) -> Pose2:
        dx, dy, dyaw = self._rng.normal(0.0, self._pose_sigma_m, 3)
        return Pose2(self.pose.x + dx, self.pose.y + dy, self.pose.yaw + dyaw)

    @property
    def known(self) -> NDArray[np.int8]:
        """The map that the lidar has made so far."""
        observed = np.where(self._odds > 0.0, 100, 0)
        return np.where(np.isnan(self._odds), -1, observed).astype(np.int8)

    def map(self) -> tuple[int, GridMap] | None:
        return self._map

    def publish_observation(self, record: ObservationRecord) -> None:
        self.records.append(record)

    def state_changed(self) -> None:
        pass

    def log(self, text: str, warning: bool = False) -> None:
        self.log_lines.append(f"{self.now:7.1f} {text}")

    # -- simulation

    def step(self) -> None:
        """Simulate STEP_S."""
        self.now += STEP_S
        actions = [act for at, act in self._scheduled if at <= self.now]
        self._scheduled = [(at, act) for at, act in self._scheduled if at > self.now]
        for act in actions:
            act()
        self._drive()
        self._detect_tags()
        ticks = round(self.now / STEP_S)
        if ticks % 10 == 0:
            self._scan(ticks // 10)
        if ticks % 5 == 0:
            found = {tag.id: tag for tag in self.world.tags if self._sightings[tag.id] >= SIGHTINGS}
            poses = {str(i): MapPose(tag.x, tag.y, tag.z, *tag_orientation(tag.yaw)) for i, tag in found.items()}
            self.orchestrator.on_tags(poses)
            self.orchestrator.on_pose(MapPose(self.pose.x, self.pose.y), (0.01, 0.01, 0.01))
        self.orchestrator.tick()

    def _grid(self, cells: NDArray[np.int8]) -> GridMap:
        return GridMap(cells, CELL_M, *self._origin)

    def _drive(self) -> None:
        if self._goal is None:
            return
        token, goal, path = self._goal
        if path is None:
            path = self._plan(goal)
            if path is None:
                self._goal = None
                self._schedule(lambda: self.orchestrator.goal_finished(token, 6), 1.0)
                return
            self._goal = (token, goal, path)
        remaining = SPEED_M_S * STEP_S
        while path and remaining > 0.0:
            dx, dy = path[0][0] - self.pose.x, path[0][1] - self.pose.y
            distance = math.hypot(dx, dy)
            move = min(remaining, distance)
            if distance > 1e-9:
                heading = self._turn_towards(math.atan2(dy, dx))
                self.pose = Pose2(self.pose.x + dx / distance * move, self.pose.y + dy / distance * move, heading)
            self.driven_m += move
            remaining -= move
            if move >= distance:
                path.pop(0)
        if not path:
            self.pose = Pose2(self.pose.x, self.pose.y, self._turn_towards(goal.yaw))
            if abs(wrap_angle(self.pose.yaw - goal.yaw)) < 0.12:
                self._goal = None
                self._schedule(lambda: self.orchestrator.goal_finished(token, 4))

    def _turn_towards(self, heading: float) -> float:
        turn = wrap_angle(heading - self.pose.yaw)
        max_turn = TURN_RAD_S * STEP_S
        return wrap_angle(self.pose.yaw + max(-max_turn, min(max_turn, turn)))

    def _plan(self, goal: Pose2) -> list[tuple[float, float]] | None:
        """Return a path that avoids known obstacles and may cross unknown cells, or None."""
        known = self.known
        cells = np.where(known >= 65, known, 0).astype(np.int8)
        clearance = ClearanceMap.from_grid(self._grid(cells))
        distance = travel_distances(clearance, goal, ROBOT_CLEARANCE_M)
        if distance is None:
            return None
        row, column = self._grid(cells).cell_of(self.pose.x, self.pose.y)
        r0, c0 = max(0, row - 8), max(0, column - 8)
        near = distance[r0 : row + 9, c0 : column + 9]
        if near.size == 0 or not np.isfinite(near.min()):
            return None
        if not np.isfinite(distance[row, column]):  # too close to an obstacle: start from the nearest cell that is not
            reachable = np.argwhere(np.isfinite(near))
            offsets = np.hypot(reachable[:, 0] + r0 - row, reachable[:, 1] + c0 - column)
            nearest = reachable[np.argmin(offsets)]
            row, column = int(nearest[0]) + r0, int(nearest[1]) + c0
        path = []
        while distance[row, column] > CELL_M:
            window = distance[row - 1 : row + 2, column - 1 : column + 2]
            dr, dc = divmod(int(np.argmin(window)), window.shape[1])
            if (dr, dc) == (1, 1):
                break
            row, column = row + dr - 1, column + dc - 1
            path.append(self._grid(cells).center_of(row, column))
        end = path[-1] if path else (self.pose.x, self.pose.y)
        if math.hypot(end[0] - goal.x, end[1] - goal.y) > 0.3:
            return None
        return [*path[::3], end]

    def _cast_rays(self, x: float, y: float, angles: NDArray[np.float64], reach: float) -> tuple[Any, Any, Any]:
        """Return rows and columns of the cells along rays (n, k), and the index of the first solid cell (n,), or k."""
        steps = np.arange(1, int(reach / (CELL_M / 2)) + 1) * (CELL_M / 2)
        columns = np.floor((x + np.outer(np.cos(angles), steps) - self._origin[0]) / CELL_M).astype(int)
        rows = np.floor((y + np.outer(np.sin(angles), steps) - self._origin[1]) / CELL_M).astype(int)
        np.clip(rows, 0, self.solid.shape[0] - 1, out=rows)
        np.clip(columns, 0, self.solid.shape[1] - 1, out=columns)
        hit = self.solid[rows, columns]
        return rows, columns, np.where(hit.any(axis=1), hit.argmax(axis=1), len(steps))

    def _scan(self, number: int) -> None:
        angles = np.linspace(-math.pi, math.pi, BEAMS, endpoint=False)
        estimated = self.robot_pose()
        rows, columns, first = self._cast_rays(self.pose.x, self.pose.y, angles, LIDAR_RANGE_M)
        hits = np.flatnonzero(first < rows.shape[1])
        noise = np.round(self._rng.normal(0.0, self._range_sigma_m, len(first)) / (CELL_M / 2)).astype(int)
        ends = np.clip(first + noise, 0, rows.shape[1] - 1)
        shift = round((estimated.y - self.pose.y) / CELL_M), round((estimated.x - self.pose.x) / CELL_M)
        rows, columns = (
            np.clip(rows + shift[0], 0, self.solid.shape[0] - 1),
            np.clip(columns + shift[1], 0, self.solid.shape[1] - 1),
        )
        # A beam has two steps per cell: the hit cell must not count as passed if the beam ends in its second step.
        hit_rows, hit_columns = rows[hits, ends[hits]], columns[hits, ends[hits]]
        passed = np.zeros(self.solid.shape, bool)
        free = np.arange(rows.shape[1])[None, :] < ends[:, None]
        passed[rows[free], columns[free]] = True
        hit = np.zeros(self.solid.shape, bool)
        hit[hit_rows, hit_columns] = True
        passed &= ~hit
        self._odds[np.isnan(self._odds) & (passed | hit)] = 0.0
        self._odds[passed] = np.maximum(self._odds[passed] - 0.4, -4.0)
        self._odds[hit] = np.minimum(self._odds[hit] + 0.9, 4.0)
        self._map = (number, self._grid(self.known))

    def _detect_tags(self) -> None:
        x, y = self.pose.apply(CAMERA_X_M, 0.0)
        for tag in self.world.tags:
            dx, dy = tag.x - x, tag.y - y
            distance = math.hypot(dx, dy)
            if distance > TAG_RANGE_M or abs(wrap_angle(math.atan2(dy, dx) - self.pose.yaw)) > HALF_FOV_RAD:
                continue
            if abs(wrap_angle(math.atan2(-dy, -dx) - tag.yaw)) > TAG_INCIDENCE_RAD:
                continue
            _, _, first = self._cast_rays(x, y, np.array([math.atan2(dy, dx)]), max(0.1, distance - 0.1))
            if first[0] * CELL_M / 2 >= distance - 0.15:
                self._sightings[tag.id] += 1


@dataclass
class MissionResult:
    """The result of a simulated mission; `missed` are the reachable tags that were not read."""

    world: str
    state: str
    reachable: int
    found: int
    read: int
    missed: list[int] = field(default_factory=list)
    exploration_s: float = 0.0
    mission_s: float = 0.0
    driven_m: float = 0.0
    goals: int = 0


def simulate_exploration(
    name: str, limit_s: float = 3600.0, range_sigma_m: float = 0.0, pose_sigma_m: float = 0.0, **parameters: Any
) -> tuple[MissionResult, MissionSimulator]:
    """Explore and monitor all tags in a world of `lupin_sim`, for at most `limit_s` of simulated time."""
    world = load_world(name)
    simulator = MissionSimulator(world, range_sigma_m, pose_sigma_m, **parameters)
    while simulator.orchestrator.hsm.top_level_state != "READY":
        simulator.step()
    for _ in range(20):
        simulator.step()
    reply = simulator.orchestrator.requests.start("ExplorationMission", (), 65535)
    if not reply.success:
        raise RuntimeError(reply.message)
    started_s = simulator.now
    explored_s = None
    while simulator.orchestrator.hsm.top_level_state not in ("DONE", "FAULT") and simulator.now - started_s < limit_s:
        simulator.step()
        if explored_s is None and simulator.orchestrator.hsm.top_level_state not in ("PREPARE", "EXPLORING"):
            explored_s = simulator.now - started_s
    reachable = reachable_tags(world)
    found = {int(tag) for tag in simulator.orchestrator._context.world_model.discovered}
    read = {int(r.tag_id) for r in simulator.records if r.status == 0 and r.source == "MonitoringMission"}
    return (
        MissionResult(
            name,
            simulator.orchestrator.hsm.top_level_state,
            len(reachable),
            len(found),
            len(read & reachable),
            sorted(reachable - read),
            explored_s or 0.0,
            simulator.now - started_s,
            simulator.driven_m,
            sum(" to (" in line for line in simulator.log_lines),
        ),
        simulator,
    )
