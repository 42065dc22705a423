"""Runs one navigation goal at a time: sends and cancels it, and copes with answers that are lost or late."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from lupin_runtime.geometry import Pose2
from lupin_runtime.mission.ports import STATUS_CANCELED, STATUS_SUCCEEDED, STATUS_UNKNOWN, Clock, Navigation

CANCEL_WAIT_S = 3.0  # the next goal waits this long for a cancelled one to end: the acknowledgement may be lost
CANCEL_REPEAT_S = 1.0
FORGET_S = 30.0
SERVER_LOST_S = 2.0  # shorter gaps of discovery happen; a server that is gone for this long has lost its goal
# DDS keeps a killed process discovered for its lease, 20 s, and the restarted process does not know the goal. Working
# navigation sends feedback many times a second; once feedback has begun, this much silence means that the goal is lost.
FEEDBACK_SILENCE_S = 5.0

DriveEnd = Literal["succeeded", "canceled", "rejected", "failed", "lost", "blind"]


@dataclass(frozen=True)
class DriveResult:
    """How a drive ended; `detail` goes into reports and is "" after a success.

    `lost`: the goal's server disappeared. `blind`: navigation gave up because lidar or odometry failed. Both say nothing
    about whether the goal can be reached.
    """

    end: DriveEnd
    detail: str = ""


@dataclass
class _Goal:
    """A goal that was sent and has not ended. `cancelled_s` is set once it is no longer wanted."""

    token: int
    accepted: bool = False
    cancelled_s: float = 0.0
    cancel_sent_s: float | None = None
    feedback_s: float | None = None


class GoalRunner:
    """Keeps at most one wanted goal.

    An unwanted goal is cancelled, on acceptance if it was not accepted yet, and again until its end is received. The next
    goal waits for that end, at most CANCEL_WAIT_S.
    """

    def __init__(self, navigation: Navigation, clock: Clock) -> None:
        self._navigation, self._clock = navigation, clock
        self._token = 0
        self._goal: _Goal | None = None
        self._cancelled: dict[int, _Goal] = {}
        self._waiting: Pose2 | None = None
        self._done: Callable[[DriveResult], None] = lambda _result: None
        self._unready_since_s: float | None = None

    @property
    def busy(self) -> bool:
        """Whether a goal is active or waits to be sent."""
        return self._goal is not None or self._waiting is not None

    @property
    def cancelling(self) -> bool:
        """Whether the end of a cancelled goal has not been received yet."""
        return bool(self._cancelled)

    def drives(self, token: int) -> bool:
        """Whether this is the current goal: sent, not ended and still wanted."""
        return self._goal is not None and self._goal.token == token

    def request(self, pose: Pose2, done: Callable[[DriveResult], None]) -> None:
        """Drive to a pose, replacing the current goal. `done` receives the result, unless `cancel` comes first."""
        self.cancel()
        self._done = done
        self._waiting = pose
        self._send_waiting()

    def cancel(self) -> None:
        """Cancel the current goal; its result is not reported."""
        self._waiting = None
        if self._goal is None:
            return
        goal, self._goal = self._goal, None
        goal.cancelled_s = self._clock.now_s()
        self._cancelled[goal.token] = goal
        if goal.accepted:
            self._send_cancel(goal)

    def tick(self) -> None:
        """Handle timeouts; call it often."""
        now = self._clock.now_s()
        for goal in list(self._cancelled.values()):
            if now - goal.cancelled_s > FORGET_S:
                # If the server accepts it after all, `accepted` sees an unknown token and cancels it.
                del self._cancelled[goal.token]
            elif goal.accepted and now - (goal.cancel_sent_s or 0.0) >= CANCEL_REPEAT_S:
                self._send_cancel(goal)
        self._send_waiting()
        self._check_server(now)
        current = self._goal
        if current is not None and current.feedback_s is not None and now - current.feedback_s >= FEEDBACK_SILENCE_S:
            self._lose_goal("nav_silent")

    def _check_server(self, now: float) -> None:
        if self._navigation.is_ready() or not (self._goal or self._cancelled):
            self._unready_since_s = None
            return
        if self._unready_since_s is None:
            self._unready_since_s = now
        elif now - self._unready_since_s >= SERVER_LOST_S and self._goal is not None:
            self._lose_goal("nav_server_lost")

    def _lose_goal(self, detail: str) -> None:
        # Discovery may only have lost sight of the server, so the goal is cancelled like any other unwanted goal.
        self.cancel()
        self._done(DriveResult("lost", detail))

    def _send_waiting(self) -> None:
        now = self._clock.now_s()
        must_wait = any(now - goal.cancelled_s < CANCEL_WAIT_S for goal in self._cancelled.values())
        if self._waiting is not None and not must_wait and self._navigation.is_ready():
            pose, self._waiting = self._waiting, None
            self._token += 1
            self._goal = _Goal(self._token)
            self._navigation.send(self._token, pose)

    def _send_cancel(self, goal: _Goal) -> None:
        goal.cancel_sent_s = self._clock.now_s()
        self._navigation.cancel(goal.token)

    # -- navigation's answers ------------------------------------------------------------------------------------------

    def accepted(self, token: int) -> None:
        """The server accepted a goal."""
        if self._goal is not None and self._goal.token == token:
            self._goal.accepted = True
        elif token in self._cancelled:
            self._cancelled[token].accepted = True
            self._send_cancel(self._cancelled[token])
        else:
            self._navigation.cancel(token)

    def feedback(self, token: int) -> None:
        """The server sent feedback for a goal."""
        if self._goal is not None and self._goal.token == token:
            self._goal.feedback_s = self._clock.now_s()

    def rejected(self, token: int, detail: str = "nav_rejected") -> None:
        """The server rejected a goal, or sending it failed."""
        self._on_end(token, DriveResult("rejected", detail))

    def finished(self, token: int, status: int, blind: bool = False) -> None:
        """A goal ended with an action status; `blind` if it failed because lidar or odometry failed."""
        if blind and status not in (STATUS_SUCCEEDED, STATUS_CANCELED):
            result = DriveResult("blind", "nav_blind")
        elif status == STATUS_SUCCEEDED:
            result = DriveResult("succeeded")
        elif status == STATUS_CANCELED:
            result = DriveResult("canceled", f"nav_status_{status}")
        elif status == STATUS_UNKNOWN:  # a restarted server does not know the goal
            result = DriveResult("lost", f"nav_status_{status}")
        else:
            result = DriveResult("failed", f"nav_status_{status}")
        self._on_end(token, result)

    def _on_end(self, token: int, result: DriveResult) -> None:
        if self._goal is not None and self._goal.token == token:
            self._goal = None
            self._done(result)
            return
        self._cancelled.pop(token, None)
        self._send_waiting()
