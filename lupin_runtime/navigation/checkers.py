"""When a goal counts as reached, and when a robot counts as stuck."""

from __future__ import annotations

from dataclasses import dataclass

from lupin_runtime.geometry import Pose2, wrap_angle


@dataclass(frozen=True)
class GoalTolerance:
    """`xy` and `yaw` are the promise to the caller (m, rad).

    Within them the robot goes on closing in until it is within the fine tolerances, or `settle_s` have passed: a camera that
    reads a tag from a standoff is worth two seconds.
    """

    xy: float = 0.25
    yaw: float = 0.12
    fine_xy: float = 0.04
    fine_yaw: float = 0.04
    settle_s: float = 2.0


class GoalChecker:
    """Stateful, as Nav2's: once the position was within tolerance only the heading is left to check."""

    def __init__(self, tolerance: GoalTolerance | None = None) -> None:
        self.tolerance = tolerance or GoalTolerance()
        self.reset()

    def reset(self) -> None:
        """For a new goal."""
        self._arrived = False
        self._within_since_s: float | None = None

    @property
    def within(self) -> bool:
        """Whether the promised tolerances were met, if not yet the fine ones."""
        return self._within_since_s is not None

    def reached(self, robot: Pose2, goal: Pose2, now_s: float) -> bool:
        """Whether the goal is reached; poses in one frame."""
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

    Turning counts, as in Nav2's pose progress checker: a robot that aligns with a goal or looks round does not stand still.
    """

    def __init__(self, distance_m: float = 0.5, angle_rad: float = 0.5, time_s: float = 10.0) -> None:
        self._distance_m, self._angle_rad, self._time_s = distance_m, angle_rad, time_s
        self.reset()

    def reset(self) -> None:
        """Start over, for a new goal or after a halt that was not the robot's."""
        self._since: tuple[Pose2, float] | None = None

    def stuck(self, robot: Pose2, now_s: float) -> bool:
        """Feed a pose of the odometry frame; whether the time is up."""
        if self._since is not None:
            mark, since_s = self._since
            moved = robot.distance_to(mark) >= self._distance_m
            if not moved and abs(wrap_angle(robot.yaw - mark.yaw)) < self._angle_rad:
                return now_s - since_s > self._time_s
        self._since = robot, now_s
        return False
