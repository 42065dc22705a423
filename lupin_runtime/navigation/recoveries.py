"""Recoveries of a stuck robot: turn on the spot, back away from obstacles, wait. Each is bounded in time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from lupin_runtime.geometry import Pose2, wrap_angle
from lupin_runtime.navigation.costmap import Costmap

Velocity = tuple[float, float, float]

STANDSTILL: Velocity = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class BehaviorLimits:
    """Speeds of the recoveries (rad/s, m/s), and how far ahead of the robot they look for obstacles (s)."""

    max_rotational_vel: float = 1.0
    min_rotational_vel: float = 0.4
    rotational_acc_lim: float = 3.2
    simulate_ahead_time: float = 2.0
    backup_speed: float = 0.15
    cycle_frequency: float = 10.0
    # The hull's corner is 0.21 m from the center: a robot nearer to an obstacle must not turn.
    turning_radius_m: float = 0.21


class Behavior(Protocol):
    """One recovery. `tick` returns the velocity to drive, or None once the recovery has ended, successful or not."""

    name: str

    def tick(self, robot: Pose2, costmap: Costmap, now_s: float) -> Velocity | None:
        """Return the velocity to drive, or None at the end; `robot` and `costmap` are in the odometry frame."""
        ...


class Wait:
    """Stand still for a while: the obstacle may move away."""

    name = "wait"

    def __init__(self, duration_s: float = 5.0) -> None:
        self._duration_s = duration_s
        self._until_s: float | None = None

    def tick(self, robot: Pose2, costmap: Costmap, now_s: float) -> Velocity | None:  # noqa: ARG002 -- Behavior's signature
        """Return standstill until the time is over, then None."""
        if self._until_s is None:
            self._until_s = now_s + self._duration_s
        return STANDSTILL if now_s < self._until_s else None


class Spin:
    """Turn by `angle_rad`, slowing down towards the end; ends at once if the hull would touch an obstacle."""

    name = "spin"

    def __init__(self, angle_rad: float = math.pi / 2, limits: BehaviorLimits | None = None) -> None:
        self._limits = limits or BehaviorLimits()
        self._remaining_rad = abs(angle_rad)
        self._sign = math.copysign(1.0, angle_rad)
        self._last_yaw: float | None = None
        self._until_s: float | None = None

    def tick(self, robot: Pose2, costmap: Costmap, now_s: float) -> Velocity | None:
        """Return the turn rate from which the robot can stop within the remaining angle, or None at the end."""
        limits = self._limits
        if self._until_s is None or self._last_yaw is None:
            self._until_s = now_s + 2.0 * self._remaining_rad / limits.min_rotational_vel
        else:
            self._remaining_rad -= self._sign * wrap_angle(robot.yaw - self._last_yaw)
        self._last_yaw = robot.yaw
        blocked = costmap.distance_at(robot.x, robot.y) < limits.turning_radius_m
        if self._remaining_rad <= 0.0 or now_s > self._until_s or blocked:
            return None
        speed = math.sqrt(2.0 * limits.rotational_acc_lim * self._remaining_rad)
        speed = min(limits.max_rotational_vel, max(limits.min_rotational_vel, speed))
        return 0.0, 0.0, self._sign * speed


class BackUp:
    """Drive `distance_m` away from obstacles: backwards if there is room, else in the direction with the most clearance.

    Nav2's BackUp drives backwards only; a mecanum base can drive in every direction.
    """

    name = "backup"
    _DIRECTIONS = 16

    def __init__(self, distance_m: float = 0.3, limits: BehaviorLimits | None = None) -> None:
        self._limits = limits or BehaviorLimits()
        self._distance_m = distance_m
        self._start: Pose2 | None = None
        self._heading: float | None = None
        self._until_s = math.inf

    def tick(self, robot: Pose2, costmap: Costmap, now_s: float) -> Velocity | None:
        """Return a velocity in the chosen direction; None at the end, or if the path ahead comes too near to an obstacle."""
        speed = self._limits.backup_speed
        if self._start is None:
            self._start = robot
            self._until_s = now_s + 2.0 * self._distance_m / speed
            self._heading = self._clearest_heading(robot, costmap)
        if self._heading is None or now_s > self._until_s or robot.distance_to(self._start) >= self._distance_m:
            return None
        ahead = min(speed * self._limits.simulate_ahead_time, self._distance_m - robot.distance_to(self._start))
        if self._clearance_along(robot, costmap, self._heading, ahead) is None:
            return None
        direction = self._heading - robot.yaw
        return speed * math.cos(direction), speed * math.sin(direction), 0.0

    def _clearest_heading(self, robot: Pose2, costmap: Costmap) -> float | None:
        best: tuple[float, float] | None = None
        for i in range(self._DIRECTIONS):
            turn = 2.0 * math.pi * i / self._DIRECTIONS
            heading = robot.yaw + math.pi + turn
            room = self._clearance_along(robot, costmap, heading, self._distance_m)
            if room is None:
                continue
            # A small penalty on other directions, so that backwards is chosen if the clearance is equal.
            value = min(room, 0.5) - 0.02 * (1.0 - math.cos(turn))
            if best is None or value > best[0] + 1e-9:
                best = value, heading
        return None if best is None else best[1]

    def _clearance_along(self, robot: Pose2, costmap: Costmap, heading: float, distance_m: float) -> float | None:
        """Return the clearance in meters at the end of the path; None if the path comes too near to an obstacle.

        Too near is nearer than the robot is now, and than the radius within which it turns.
        """
        clearance_now = costmap.distance_at(robot.x, robot.y)
        # Half a cell of slack, because distances jump by that much between cells.
        min_clearance = min(clearance_now, self._limits.turning_radius_m + costmap.resolution_m) - 0.5 * costmap.resolution_m
        clearance = clearance_now
        steps = max(1, math.ceil(distance_m / (0.5 * costmap.resolution_m)))
        for i in range(1, steps + 1):
            along_m = distance_m * i / steps
            clearance = costmap.distance_at(robot.x + along_m * math.cos(heading), robot.y + along_m * math.sin(heading))
            if clearance < min_clearance:
                return None
        return clearance
