"""Navigation in closed loop without ROS: boxes, a lidar by ray casting, and a kinematic mecanum base with a lag."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from lupin_runtime.geometry import Pose2, wrap_angle
from lupin_runtime.gridmap import GridMap
from lupin_runtime.navigation.costmap import BeamPoses, Costmap, GlobalCostmap, LocalCostmap, RangeScan
from lupin_runtime.navigation.decision import Decision, View
from lupin_runtime.navigation.executive import Executive
from lupin_runtime.navigation.planning import NoPath, Plan, plan

Box = tuple[float, float, float, float]  # x0, y0, x1, y1

RESOLUTION_M = 0.05
HALF_LENGTH_M, HALF_WIDTH_M = 0.14, 0.157
BEAMS = 360


@dataclass
class Arena:
    """A rectangular area with walls that are 0.1 m thick, and with boxes in it."""

    width_m: float
    height_m: float
    boxes: list[Box] = field(default_factory=list)

    def solids(self) -> list[Box]:
        """Return walls and boxes."""
        w, h, t = self.width_m, self.height_m, 0.1
        return [*self.boxes, (-t, -t, 0.0, h + t), (w, -t, w + t, h + t), (-t, -t, w + t, 0.0), (-t, h, w + t, h + t)]

    def grid(self) -> GridMap:
        """Return the map of the arena: solids are occupied, the rest is free."""
        margin = 0.5
        columns, rows = (math.ceil((s + 2 * margin) / RESOLUTION_M) for s in (self.width_m, self.height_m))
        x = -margin + (np.arange(columns) + 0.5) * RESOLUTION_M
        y = -margin + (np.arange(rows) + 0.5) * RESOLUTION_M
        cells = np.zeros((rows, columns), np.int8)
        for x0, y0, x1, y1 in self.solids():
            cells[np.ix_((y >= y0) & (y <= y1), (x >= x0) & (x <= x1))] = 100
        return GridMap(cells, RESOLUTION_M, -margin, -margin)

    def ranges(self, sensor: Pose2, random: np.random.Generator | None = None) -> np.ndarray:
        """Return BEAMS ranges of a sensor, infinite beyond 12 m, with 5 mm of noise if `random` is given (slab method)."""
        angles = sensor.yaw + 2 * np.pi * np.arange(BEAMS) / BEAMS
        dx, dy = np.cos(angles), np.sin(angles)
        best = np.full(BEAMS, np.inf)
        with np.errstate(divide="ignore", invalid="ignore"):
            for x0, y0, x1, y1 in self.solids():
                tx = np.sort(np.stack(((x0 - sensor.x) / dx, (x1 - sensor.x) / dx)), axis=0)
                ty = np.sort(np.stack(((y0 - sensor.y) / dy, (y1 - sensor.y) / dy)), axis=0)
                near, far = np.maximum(tx[0], ty[0]), np.minimum(tx[1], ty[1])
                hit = (near <= far) & (far > 0) & (near > 0)
                best = np.where(hit & (near < best), near, best)
        if random is not None:
            best = best + random.normal(0.0, 0.005, BEAMS)
        return np.where(best < 12.0, best, np.inf).astype(np.float32)

    def touches(self, robot: Pose2) -> bool:
        """Return whether the robot's footprint, a rectangle, overlaps a solid (separating axes)."""
        c, s = math.cos(robot.yaw), math.sin(robot.yaw)
        reach_x = HALF_LENGTH_M * abs(c) + HALF_WIDTH_M * abs(s)
        reach_y = HALF_LENGTH_M * abs(s) + HALF_WIDTH_M * abs(c)
        for x0, y0, x1, y1 in self.solids():
            mx, my, ex, ey = (x0 + x1) / 2 - robot.x, (y0 + y1) / 2 - robot.y, (x1 - x0) / 2, (y1 - y0) / 2
            if abs(mx) > reach_x + ex or abs(my) > reach_y + ey:
                continue
            along, across = abs(c * mx + s * my), abs(-s * mx + c * my)
            if along <= HALF_LENGTH_M + abs(c) * ex + abs(s) * ey and across <= HALF_WIDTH_M + abs(s) * ex + abs(c) * ey:
                return True
        return False


@dataclass
class Base:
    """A mecanum base: velocity follows the command within acceleration limits and with a lag; odometry may drift."""

    truth: Pose2
    lag_s: float = 0.1
    drift: float = 0.0
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    odometry: Pose2 = field(default_factory=Pose2)

    def drive(self, command: tuple[float, float, float], dt: float) -> None:
        """Move for `dt`."""
        limits = (2.5 * dt, 2.5 * dt, 3.2 * dt)
        share = min(1.0, dt / self.lag_s)
        vx, vy, wz = (v + max(-limit, min(limit, (c - v) * share)) for v, c, limit in zip(self.velocity, command, limits))
        self.velocity = vx, vy, wz
        step = Pose2(vx * dt, vy * dt, wz * dt)
        self.truth = self.truth @ step
        self.odometry = self.odometry @ Pose2(step.x * (1 + self.drift), step.y, step.yaw * (1 - self.drift))


class DirectPlanner:
    """A planner that plans at once, on a global costmap."""

    def __init__(self, costmap: GlobalCostmap) -> None:
        self.costmap = costmap
        self.requests = 0
        self._result: Plan | NoPath | None = None

    def request(self, start: Pose2, goals: Sequence[Pose2]) -> None:
        self.requests += 1
        snapshot = self.costmap.snapshot(start)
        points: list[np.ndarray] = []
        at = (start.x, start.y)
        try:
            for goal in goals:
                leg = plan(snapshot, at, (goal.x, goal.y))
                points.append(leg.points if not points else leg.points[1:])
                at = leg.goal
            self._result = Plan(np.vstack(points))
        except NoPath as failure:
            self._result = failure

    def take(self) -> Plan | NoPath | None:
        result, self._result = self._result, None
        return result

    def drop(self) -> None:
        self._result = None

    def clear_obstacles(self) -> None:
        self.costmap.clear()


class Drive:
    """A closed loop of executive, costmaps and base: 20 Hz control, 10 Hz lidar, 5 Hz local and 1 Hz global updates."""

    def __init__(self, arena: Arena, start: Pose2, drift: float = 0.0, seed: int = 1, grid: GridMap | None = None) -> None:
        self.arena = arena
        self.base = Base(start, drift=drift)
        self.random = np.random.default_rng(seed)
        self.local = LocalCostmap()
        self.world = GlobalCostmap()
        self.world.set_map(grid if grid is not None else arena.grid())
        self.planner = DirectPlanner(self.world)
        self.logs: list[str] = []
        self.executive = Executive(self.planner, clear_local=self.local.clear, log=self.logs.append)
        self.now_s = 0.0
        self.tick = 0
        self.snapshot: Costmap | None = None
        self.lidar_fault: str | None = None
        # Cycles from one local update to the next; more than 4 simulate a slow machine.
        self.scan_every = 4
        self.last_scan_s = 0.0
        self.collisions = 0
        self.track: list[Pose2] = [start]
        self.commands: list[tuple[float, float, float]] = []

    def step(self) -> Decision:
        """Simulate one control cycle of 50 ms, and return the executive's decision."""
        base = self.base
        map_from_odom = base.truth @ base.odometry.inverse()
        if self.tick % self.scan_every == 0:
            self.last_scan_s = self.now_s
            ranges = self.arena.ranges(base.truth, self.random)
            scan = RangeScan(ranges, 0.0, 2 * math.pi / BEAMS)
            self.local.roll_to(base.odometry.x, base.odometry.y)
            self.local.observe(scan, BeamPoses(base.odometry, base.odometry))
            self.snapshot = self.local.snapshot(base.odometry)
            if self.tick % 20 == 0:
                self.world.observe(scan, BeamPoses(base.truth, base.truth))
        decision = self.executive.tick(
            View(
                self.now_s,
                base.odometry,
                map_from_odom,
                base.velocity,
                self.snapshot,
                self.lidar_fault,
                self.now_s - self.last_scan_s,
            )
        )
        self.commands.append(decision.velocity)
        for _ in range(5):
            base.drive(decision.velocity, 0.01)
        self.collisions += self.arena.touches(base.truth)
        self.track.append(base.truth)
        self.now_s += 0.05
        self.tick += 1
        return decision

    def go(self, *goals: Pose2, limit_s: float = 120.0) -> Decision:
        """Navigate through the goals until the executive has finished. Fails the test after `limit_s` of simulated time."""
        self.executive.start(goals, self.now_s)
        end = self.now_s + limit_s
        while self.now_s < end:
            decision = self.step()
            if decision.finished:
                return decision
        raise AssertionError(f"not finished after {limit_s} s; at {self.base.truth}, log {self.logs}")

    def error_to(self, goal: Pose2) -> tuple[float, float]:
        """Return the distance (m) and angle (rad) from the true pose to a goal."""
        return self.base.truth.distance_to(goal), abs(wrap_angle(self.base.truth.yaw - goal.yaw))

    def driven_m(self) -> float:
        """Return the true driven distance, m."""
        return sum(a.distance_to(b) for a, b in zip(self.track, self.track[1:]))


def greenhouse(rows: int = 3, aisle_m: float = 0.9) -> Arena:
    """Return an arena with rows of benches of 2.4 x 0.6 m, and aisles of `aisle_m` around them."""
    width = 2 * aisle_m + 2.4
    height = (rows + 1) * aisle_m + rows * 0.6
    boxes = [(aisle_m, aisle_m + i * (aisle_m + 0.6), aisle_m + 2.4, aisle_m + i * (aisle_m + 0.6) + 0.6) for i in range(rows)]
    return Arena(width, height, boxes)


def random_arena(seed: int, min_aisle_m: float = 0.9) -> Arena:
    """Return an arena with sides of 6 to 10 m and random boxes, with at least `min_aisle_m` between them and to the walls."""
    random = np.random.default_rng(seed)
    width, height = random.uniform(6.0, 10.0, 2)
    boxes: list[Box] = []
    gap = min_aisle_m
    for _ in range(400):
        w, h = random.uniform(0.3, 2.4), random.uniform(0.3, 0.8)
        if random.random() < 0.5:
            w, h = h, w
        x, y = random.uniform(gap, max(width - gap - w, gap)), random.uniform(gap, max(height - gap - h, gap))
        if x + w > width - gap or y + h > height - gap:
            continue
        if all(x - gap >= b[2] or x + w + gap <= b[0] or y - gap >= b[3] or y + h + gap <= b[1] for b in boxes):
            boxes.append((x, y, x + w, y + h))
    return Arena(float(width), float(height), boxes)
