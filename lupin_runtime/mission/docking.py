"""RETURNING: drive to the dock; after a diversion, wait there and remember which state to resume."""

from __future__ import annotations

from typing import Literal

from lupin_runtime.mission.activity import Activity
from lupin_runtime.mission.context import Context
from lupin_runtime.mission.driving import MAX_SENSOR_LOSSES, SENSORS_LOST_WAIT_S
from lupin_runtime.mission.goal_runner import DriveResult

DockReason = Literal["complete", "abort", "battery", "dock"]

RETRY_AFTER_S = 1.0
MAX_STALE_CANCELS = 1
MAX_LOST = 3  # goals whose navigation server disappeared


class Docking(Activity):
    """The drive to the dock. `resume_state` is the state that a low battery or a dock request interrupted."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self.begin("complete", None)

    def begin(self, reason: DockReason, resume_state: str | None) -> None:
        """Prepare a return to the dock; call it before RETURNING is entered."""
        self.reason: DockReason = reason
        self.resume_state = resume_state
        self.docked = False
        self._prepared = True
        self._not_before_s = 0.0
        self.retry()

    def retry(self) -> None:
        """Reset the counters of failures, so that the robot tries again."""
        self.gave_up = False
        self._retries = 0
        self._stale_cancels = 0
        self._lost = 0
        self._sensor_losses = 0
        self._unready_since_s: float | None = None

    def enter(self, substate: str) -> None:
        if not self._prepared:
            self.begin("complete", None)
        self._prepared = False

    def leave(self) -> None:
        self._context.driver.stop()
        self.docked = False

    def stop_motion(self) -> None:
        self._context.driver.stop()

    def tick(self) -> None:
        context, now = self._context, self._context.now_s
        if self.docked or self.gave_up:
            return
        if context.driver.busy:
            if context.driver.age_s >= context.config.dock_timeout_s:
                context.driver.stop()
                self._on_failure("dock_timeout")
            return
        if now < self._not_before_s:
            return
        if not context.ports.navigation.is_ready():
            if self._unready_since_s is None:
                self._unready_since_s = now
            elif now - self._unready_since_s >= context.config.dock_timeout_s:
                self._unready_since_s = None
                self._on_failure("nav_unavailable")
            return
        self._unready_since_s = None
        context.driver.drive(context.dock, self._on_drive_end)

    def _on_drive_end(self, result: DriveResult) -> None:
        context = self._context
        if result.end == "succeeded":
            self._on_arrival()
        elif result.end == "lost" and self._lost < MAX_LOST:
            self._lost += 1
            self._not_before_s = context.now_s + RETRY_AFTER_S
        elif result.end == "sensors_lost" and self._sensor_losses < MAX_SENSOR_LOSSES:
            context.last_error = result.detail
            self._sensor_losses += 1
            self._not_before_s = context.now_s + SENSORS_LOST_WAIT_S
        elif result.end == "canceled" and not context.battery.low and self._stale_cancels < MAX_STALE_CANCELS:
            # A late cancel of the previous drive may have hit this goal: send it again, but not endlessly.
            self._stale_cancels += 1
            self._not_before_s = context.now_s + RETRY_AFTER_S
        else:
            self._on_failure(result.detail)

    def _on_arrival(self) -> None:
        if self.resume_state is None:
            self._context.fire("returned")
            return
        self.docked = True
        self._context.pause()

    def _on_failure(self, detail: str) -> None:
        context = self._context
        context.ports.publisher.log(f"dock: {detail}", warning=True)
        if self.reason != "battery":
            context.last_error = detail
            context.fire("returned")
            return
        self._retries += 1
        if self._retries <= context.config.dock_retry_max:
            self._not_before_s = context.now_s + RETRY_AFTER_S
            return
        self.gave_up = True
        context.last_error = "dock_unreachable"
        context.pause()
