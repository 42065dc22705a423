"""PREPARE: wait for a pose with a small variance before the first drive."""

from __future__ import annotations

from lupin_runtime.mission.activity import Activity
from lupin_runtime.mission.context import Context


class Localizing(Activity):
    """Fires `localized`, or `fault` after the timeout. Time spent paused does not count."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._waited_s = 0.0
        self._last_tick_s: float | None = None

    def enter(self, substate: str) -> None:
        self._waited_s, self._last_tick_s = 0.0, None

    def stop_motion(self) -> None:
        self._last_tick_s = None

    def tick(self) -> None:
        context, now = self._context, self._context.now_s
        config = context.config
        if self._last_tick_s is not None:
            self._waited_s += now - self._last_tick_s
        self._last_tick_s = now
        variance = context.world_model.largest_variance
        if variance is not None and variance <= config.localization_covariance_threshold:
            context.fire("localized")
        elif self._waited_s >= config.localization_timeout_s:
            context.last_error = "localization_failed"
            found = "no pose was received" if variance is None else f"the pose's variance is {variance:.3f}"
            context.ports.publisher.log(
                f"not localized after {self._waited_s:.0f} s: {found} on {config.amcl_pose_topic}, expected at most"
                f" {config.localization_covariance_threshold}; fix the localization, then run: lupin mission reset",
                warning=True,
            )
            context.fire("fault")
