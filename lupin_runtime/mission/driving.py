"""Drives with the arm at its travel preset: an arm that is held stretched out overheats its shoulder servo."""

from __future__ import annotations

from collections.abc import Callable

from lupin_runtime.geometry import Pose2
from lupin_runtime.mission.config import MissionConfig
from lupin_runtime.mission.goal_runner import DriveResult, GoalRunner
from lupin_runtime.mission.ports import Arm, Clock

# Navigation stands still for 10 s before it reports lost sensors, so a goal is sent again for about five minutes.
MAX_SENSOR_LOSSES = 20
SENSORS_LOST_WAIT_S = 5.0


class Driver:
    """Drives to poses.

    With `arm_patrol_enabled` it first sends the arm to the travel preset, and waits `arm_travel_settle_s`, whenever the arm
    may be elsewhere.
    """

    def __init__(self, runner: GoalRunner, arm: Arm, clock: Clock, config: MissionConfig) -> None:
        self._runner, self._arm, self._clock, self._config = runner, arm, clock, config
        self._arm_may_be_extended = True  # its position is unknown before the first drive
        self._settling: tuple[Pose2, Callable[[DriveResult], None], float] | None = None
        self._started_s = 0.0

    @property
    def busy(self) -> bool:
        """Whether a drive is in progress, including the time in which the arm settles."""
        return self._settling is not None or self._runner.busy

    @property
    def age_s(self) -> float:
        """Seconds since the goal was requested; 0 while the arm settles."""
        return 0.0 if self._settling is not None else self._clock.now_s() - self._started_s

    def drive(self, pose: Pose2, done: Callable[[DriveResult], None]) -> None:
        """Drive to a pose; `done` receives the result, unless `stop` comes first."""
        patrol = self._config.arm_patrol_enabled
        if patrol and self._arm_may_be_extended and self._arm.move_to_preset(self._config.arm_travel_preset):
            self._settling = (pose, done, self._clock.now_s())
            self.tick()
            return
        self._send_goal(pose, done)

    def move_arm(self, preset: str) -> None:
        """Move the arm while the robot stands still; does nothing without `arm_patrol_enabled`."""
        if self._config.arm_patrol_enabled:
            self._arm_may_be_extended = self._arm.move_to_preset(preset) or self._arm_may_be_extended

    def stop(self) -> None:
        """Cancel the drive; its result is not reported."""
        self._settling = None
        self._runner.cancel()

    def tick(self) -> None:
        """Send the goal once the arm has settled."""
        if self._settling is not None:
            pose, done, since = self._settling
            if self._clock.now_s() - since >= self._config.arm_travel_settle_s:
                self._settling = None
                self._arm_may_be_extended = False
                self._send_goal(pose, done)

    def _send_goal(self, pose: Pose2, done: Callable[[DriveResult], None]) -> None:
        self._started_s = self._clock.now_s()
        self._runner.request(pose, done)
