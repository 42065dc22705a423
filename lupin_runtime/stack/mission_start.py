"""The start of a run's mission: one request, whose answer may be lost or a refusal because a mission runs already."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from lupin_runtime.graph import MISSION_START
from lupin_runtime.mission.hsm_spec import BUSY

ANSWER_TIMEOUT_S = 10.0
# The mission's state may arrive after the answer that refers to it.
STATE_TIMEOUT_S = 1.0
# The mission refuses a request while the e-stop's process has not heard every source, and notices the release up to 1 s later.
SOURCES_TIMEOUT_S = 30.0
RELEASE_S = 2.0


class MissionState(Protocol):
    """What a MissionState message says about the mission in progress."""

    mission_id: str
    lifecycle_state: str


class MissionStart:
    """Starts the mission that the run follows. Call `step` often, also before every process is up.

    A mission that is in progress is followed instead: an operator may have started it while other processes were still coming
    up, or the answer to the own request was lost. The request is never repeated, because the mission may have started and ended
    since.
    """

    def __init__(self, is_ready: Callable[[], bool], request: Callable[[Callable[[bool, str], None]], None]) -> None:
        """`is_ready` tells whether the service is available; `request` calls it, and the callback with the answer, as
        `GraphMonitor.start_mission` does."""
        self._is_ready, self._request = is_ready, request
        self._requested = False
        self._deadline_s: float | None = None
        self._first_s: float | None = None
        self._not_before_s = 0.0
        self._problem = f"{MISSION_START.name} did not answer within {ANSWER_TIMEOUT_S:g} s; see: lupin logs mission"
        self._answer: tuple[bool, str] | None = None
        self.mission_id = ""  # of the mission that the run follows
        self.refusal = ""  # why it follows none

    def step(
        self, now_s: float, state: MissionState | None, was_pressed: bool, estop_waits: bool = False, all_up: bool = True
    ) -> None:
        """Send the request, handle its answer and its absence. `state` is the mission's last one, `now_s` monotonic.

        Nothing is sent before `all_up`: every process is up, or was.

        The request is held back while `estop_waits`, whether the e-stop's process was not heard yet or has not heard every
        source; but not for ever: its refusal then tells the reason.
        """
        if self.mission_id or self.refusal:
            return
        if all_up and self._first_s is None:
            self._first_s = now_s
        # The release may come just before the last process is up.
        if estop_waits and (self._first_s is None or now_s - self._first_s < SOURCES_TIMEOUT_S):
            self._not_before_s = now_s + RELEASE_S
        if not all_up:
            return
        if self._deadline_s is None:
            self._deadline_s = now_s + ANSWER_TIMEOUT_S
        if self._answer is not None and self._answer[0]:
            self.mission_id = self._answer[1]
        elif state is not None and state.lifecycle_state in BUSY and state.mission_id:
            self.mission_id = state.mission_id
        elif was_pressed and not self._requested:
            # The command to start the mission is older than the release: it starts nothing.
            self.refusal = "the e-stop was pressed meanwhile; start it with: lupin mission start"
        elif now_s < self._not_before_s and not self._requested:
            self._deadline_s = now_s + ANSWER_TIMEOUT_S
        elif now_s >= self._deadline_s:
            self.refusal = self._problem
        elif self._answer is not None:
            self._problem, self._answer = self._answer[1], None
            self._deadline_s = now_s + STATE_TIMEOUT_S
        elif not self._requested and self._is_ready():
            self._requested = True
            self._request(self._take_answer)

    def _take_answer(self, accepted: bool, text: str) -> None:
        self._answer = accepted, text
