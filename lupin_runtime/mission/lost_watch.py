"""Stops a mission while its robot is lost, and ends the mission if the robot is not found."""

from __future__ import annotations

from collections.abc import Callable

from lupin_runtime.mission.context import Context
from lupin_runtime.mission.hsm import MissionHsm
from lupin_runtime.mission.hsm_spec import RESUMABLE, RETURNING

LOST = "robot_lost"


class LostWatch:
    """While `lost`, the mission must not advance. PREPARE has its own wait for a pose."""

    def __init__(self, context: Context, hsm: MissionHsm, stop_motion: Callable[[], None]) -> None:
        self._context, self._hsm, self._stop_motion = context, hsm, stop_motion
        self.lost = False
        self._waited_s = 0.0
        self._last_tick_s = 0.0

    def tick(self) -> None:
        """Compare the newest pose with the mission's state. Call it about 10 times a second."""
        context, now = self._context, self._context.now_s
        elapsed_s, self._last_tick_s = now - self._last_tick_s, now
        lost = context.world_model.lost and self._hsm.top_level_state in RESUMABLE | {RETURNING}
        if lost != self.lost:
            self._change(lost)
        elif lost and not (context.paused or context.estop_engaged):
            self._waited_s += elapsed_s
            if context.last_error != LOST:  # after a stop, say again why the mission does not go on
                context.last_error = LOST
                context.ports.publisher.state_changed()
            if self._waited_s >= context.config.localization_timeout_s:
                self._give_up()

    def _change(self, lost: bool) -> None:
        context = self._context
        self.lost, self._waited_s = lost, 0.0
        if lost:
            context.last_error = LOST
            context.ports.publisher.log("the robot is lost: the mission waits until it is found on the map", warning=True)
            self._stop_motion()
        elif not context.world_model.lost:
            context.last_error = "robot_found"
            context.ports.publisher.log("the robot was found: the mission goes on")
        context.ports.publisher.state_changed()

    def _give_up(self) -> None:
        context = self._context
        self.lost = False
        context.last_error = "robot_not_found"
        context.ports.publisher.log(
            f"the robot was not found on the map in {self._waited_s:.0f} s; show it where it is on the console's map, or start"
            " on a map of the whole greenhouse, then run: lupin mission reset",
            warning=True,
        )
        context.fire("fault")
