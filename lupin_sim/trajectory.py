"""The vendor's joint trajectory controller: four joints, open loop, no partial goals."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

from lupin_runtime.graph import ARM_JOINTS


class TrajectoryRefused(ValueError):
    """The controller refuses a trajectory; the message says why."""


@dataclass(frozen=True)
class Trajectory:
    """Waypoints: seconds from the start, and radians in the order of ARM_JOINTS."""

    times_s: tuple[float, ...]
    points: tuple[tuple[float, ...], ...]


def parse(joint_names: Sequence[str], positions: Sequence[Sequence[float]], times_s: Sequence[float]) -> Trajectory:
    """Check a trajectory as the controller does, and sort its joints in the order of ARM_JOINTS. Raises TrajectoryRefused."""
    if sorted(joint_names) != sorted(ARM_JOINTS):
        raise TrajectoryRefused(f"needs exactly the joints {', '.join(ARM_JOINTS)}; got {', '.join(joint_names) or 'none'}")
    if not positions:
        raise TrajectoryRefused("has no points")
    order = [list(joint_names).index(joint) for joint in ARM_JOINTS]
    last = -1.0
    for index, (point, time_s) in enumerate(zip(positions, times_s)):
        if len(point) != len(ARM_JOINTS):
            raise TrajectoryRefused(f"point {index} has {len(point)} positions, not {len(ARM_JOINTS)}")
        if not all(map(math.isfinite, point)):
            raise TrajectoryRefused(f"point {index} is not finite: {[float(v) for v in point]}")
        if not time_s > last:
            raise TrajectoryRefused(f"point {index} at {time_s} s is not after the previous one")
        last = time_s
    return Trajectory(tuple(times_s), tuple(tuple(float(point[i]) for i in order) for point in positions))


class TrajectoryController:
    """Computes the arm's command over time: linear interpolation between waypoints, starting at the last command."""

    def __init__(self, start: Sequence[float]) -> None:
        self.command = tuple(float(v) for v in start)
        self._trajectory: Trajectory | None = None
        self._start = self.command
        self._start_s = 0.0
        self.goals = 0  # counts commands, so that an action can tell that another one replaced its own

    @property
    def finished(self) -> bool:
        """Whether no waypoint is left."""
        return self._trajectory is None

    def follow(self, trajectory: Trajectory, now_s: float) -> int:
        """Replace the current trajectory; returns the value of `goals` for this one."""
        self._trajectory, self._start, self._start_s = trajectory, self.command, now_s
        self.goals += 1
        return self.goals

    def hold(self, position: Sequence[float]) -> None:
        """Drop the trajectory and command this position."""
        self.command = tuple(float(v) for v in position)
        self._trajectory = None
        self.goals += 1

    def step(self, now_s: float) -> tuple[float, ...]:
        """Return the command at time `now_s`, radians in the order of ARM_JOINTS."""
        trajectory = self._trajectory
        if trajectory is not None:
            elapsed_s = now_s - self._start_s
            index = bisect_right(trajectory.times_s, elapsed_s)
            if index == len(trajectory.points):
                self.command = trajectory.points[-1]
                self._trajectory = None
            else:
                t0 = trajectory.times_s[index - 1] if index else 0.0
                p0 = trajectory.points[index - 1] if index else self._start
                f = max(0.0, elapsed_s - t0) / (trajectory.times_s[index] - t0)
                self.command = tuple(a + f * (b - a) for a, b in zip(p0, trajectory.points[index]))
        return self.command
