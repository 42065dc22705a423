"""Checks whether the goal is reached, and whether the robot is stuck."""

from __future__ import annotations

from dataclasses import dataclass

from lupin_runtime.geometry import Pose2, wrap_angle


@dataclass(frozen=True)
class GoalTolerance:
    """`xy` (m) and `yaw` (rad) are the tolerances that a caller can rely on.

    Within them the robot continues to improve its pose until it is also within `fine_xy` and `fine_yaw`, or `settle_s` have
    passed, because a camera reads a tag more reliably from the exact pose.
    """

    xy: float = 0.25
    yaw: float = 0.12
    fine_xy: float = 0.04
    fine_yaw: float = 0.04
    settle_s: float = 2.0


class GoalChecker:
    """Checks whether the goal is reached: `settle_s` after the tolerances were first met, or once the fine ones are met.

    The position tolerance is latched, as in Nav2: once it was met, only yaw decides.
    """

    def __init__(self, tolerance: GoalTolerance | None = None) -> None:
        self.tolerance = tolerance or GoalTolerance()
        self.reset()

    def reset(self) -> None:
        """Start over, for a new goal."""
        self._arrived = False
        self._within_since_s: float | None = None

    @property
    def was_within_tolerance(self) -> bool:
        """Whether the robot was within `xy` and `yaw` at least once."""
        return self._within_since_s is not None

    def reached(self, robot: Pose2, goal: Pose2, now_s: float) -> bool:
        """Record the pose; return whether the goal is reached. Both poses are in one frame."""
        t = self.tolerance
        away, turn = robot.distance_to(goal), abs(wrap_angle(robot.yaw - goal.yaw))
        self._arrived = self._arrived or away <= t.xy
        if not self._arrived or turn > t.yaw:
            return False
        if self._within_since_s is None:
            self._within_since_s = now_s
        fine = away <= t.fine_xy and turn <= t.fine_yaw
        return fine or now_s - self._within_since_s >= t.settle_s


class ProgressChecker:
    """A robot that neither moved `distance_m` nor turned `angle_rad` within `time_s` is stuck.

    Turning counts, as in Nav2's pose progress checker: a robot that aligns with a goal is not stuck.
    """

    def __init__(self, distance_m: float = 0.5, angle_rad: float = 0.5, time_s: float = 10.0) -> None:
        self._distance_m, self._angle_rad, self._time_s = distance_m, angle_rad, time_s
        self.reset()

    def reset(self) -> None:
        """Start over, for a new goal or after a commanded halt."""
        self._last_progress: tuple[Pose2, float] | None = None

    def stuck(self, robot: Pose2, now_s: float) -> bool:
        """Record the pose, in the odometry frame; return whether the robot is stuck."""
        if self._last_progress is not None:
            reference, since_s = self._last_progress
            moved = robot.distance_to(reference) >= self._distance_m
            if not moved and abs(wrap_angle(robot.yaw - reference.yaw)) < self._angle_rad:
                return now_s - since_s > self._time_s
        self._last_progress = robot, now_s
        return False
