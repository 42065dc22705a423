"""RETURNING: drive to the dock; after a diversion wait there, and know the way back to what was left."""

from __future__ import annotations

from typing import Literal

from lupin_runtime.geometry import Pose2
from lupin_runtime.mission.context import Context
from lupin_runtime.mission.driving import BLIND_WAIT_S, MAX_BLIND, Outcome

Reason = Literal["complete", "abort", "battery", "dock"]

RETRY_AFTER_S = 1.0
MAX_STALE_CANCELS = 1
MAX_LOST = 3  # goals that went down with their server


class Homing:
    """The way to the dock. `origin` is the family that a battery return or a dock request left, and comes back to."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self.begin("complete", None)

    def begin(self, reason: Reason, origin: str | None) -> None:
        """Set out for another reason; called before RETURNING is entered."""
        self.reason: Reason = reason
        self.origin = origin
        self.docked = False
        self.gave_up = False
        self._begun = True
        self._retries = 0
        self._stale_cancels = 0
        self._lost = 0
        self._blind = 0
        self._not_before_s = 0.0
        self._unready_since_s: float | None = None

    def enter(self, leaf: str) -> None:
        """RETURNING begins."""
        if not self._begun:
            self.begin("complete", None)
        self._begun = False

    def leave(self) -> None:
        """RETURNING ends."""
        self._context.driver.stop()
        self.docked = False

    def hold(self) -> None:
        """Stop moving."""
        self._context.driver.stop()

    def retry(self) -> None:
        """The operator lets it try again."""
        self.gave_up = False
        self._retries = 0
        self._stale_cancels = 0
        self._lost = 0
        self._blind = 0
        self._unready_since_s = None

    def tick(self) -> None:
        """Go on; never called while blocked."""
        context, now = self._context, self._context.now_s
        if self.docked or self.gave_up:
            return
        if context.driver.busy:
            if context.driver.age_s >= context.config.dock_timeout_s:
                context.driver.stop()
                self._failed("dock_timeout")
            return
        if now < self._not_before_s:
            return
        if not context.ports.navigation.is_ready():
            if self._unready_since_s is None:
                self._unready_since_s = now
            elif now - self._unready_since_s >= context.config.dock_timeout_s:
                self._unready_since_s = None
                self._failed("nav_unavailable")
            return
        self._unready_since_s = None
        context.driver.drive(context.dock or Pose2(), self._ended)

    def _ended(self, outcome: Outcome) -> None:
        context = self._context
        if outcome.end == "succeeded":
            self._arrived()
        elif outcome.end == "lost" and self._lost < MAX_LOST:
            self._lost += 1
            self._not_before_s = context.now_s + RETRY_AFTER_S
        elif outcome.end == "blind" and self._blind < MAX_BLIND:
            context.note(outcome.detail)
            self._blind += 1
            self._not_before_s = context.now_s + BLIND_WAIT_S
        elif outcome.end == "canceled" and not context.battery_low() and self._stale_cancels < MAX_STALE_CANCELS:
            # A cancel of the leg before may have hit this goal: sent again, but not for ever.
            self._stale_cancels += 1
            self._not_before_s = context.now_s + RETRY_AFTER_S
        else:
            self._failed(outcome.detail)

    def _arrived(self) -> None:
        if self.origin is None:
            self._context.fire("returned")
            return
        self.docked = True
        self._context.pause()

    def _failed(self, detail: str) -> None:
        context = self._context
        context.ports.outlet.log(f"dock: {detail}", warning=True)
        if self.reason != "battery":
            context.note(detail)
            context.fire("returned")
            return
        self._retries += 1
        if self._retries <= context.config.dock_retry_max:
            self._not_before_s = context.now_s + RETRY_AFTER_S
            return
        self.gave_up = True
        context.note("dock_unreachable")
        context.pause()
