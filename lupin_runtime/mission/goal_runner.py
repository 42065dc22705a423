"""Runs one navigation goal at a time: sends and cancels it, and copes with answers that are lost or late."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from lupin_runtime.geometry import Pose2
from lupin_runtime.mission.ports import STATUS_CANCELED, STATUS_SUCCEEDED, STATUS_UNKNOWN, Clock, Navigation

CANCEL_WAIT_S = 3.0  # at most this long the next goal waits for the end of a cancelled one, whose result may be lost
CANCEL_REPEAT_S = 1.0
FORGET_S = 30.0
SERVER_LOST_S = 2.0  # shorter gaps of discovery happen; a server that is gone for this long has lost its goal
# A killed process stays discovered until its DDS lease of 20 s expires, and the restarted process does not know the goal.
# Working navigation sends feedback many times a second; after the first feedback, this much silence means a lost goal.
FEEDBACK_SILENCE_S = 5.0

DriveEnd = Literal["succeeded", "canceled", "rejected", "failed", "lost", "sensors_lost"]


@dataclass(frozen=True)
class DriveResult:
    """How a drive ended; `detail` goes into reports and is "" after a success.

    `lost`: the goal's server disappeared. `sensors_lost`: navigation gave up because lidar or odometry failed. In both cases
    the goal may still be reachable.
    """

    end: DriveEnd
    detail: str = ""


@dataclass
class _Goal:
    """A goal that was sent and has not ended. `cancelled_s` is the time at which it was given up."""

    token: int
    cancelled_s: float = 0.0
    cancel_sent_s: float = 0.0
    feedback_s: float | None = None


class GoalRunner:
    """Runs at most one goal at a time.

    A goal that is given up is cancelled at once, also if its acceptance was not received: that answer can be lost, and the
    robot drive all the same. The cancel request is repeated on acceptance, because it may have overtaken the goal, and until
    the goal's end is received. The next goal waits for that end, at most CANCEL_WAIT_S.
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
        """Whether a goal is active or waiting to be sent."""
        return self._goal is not None or self._waiting is not None

    @property
    def cancelling(self) -> bool:
        """Whether the end of a cancelled goal has not been received yet."""
        return bool(self._cancelled)

    def is_current(self, token: int) -> bool:
        """Return whether this is the current goal: sent, not ended and not given up."""
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
        self._send_cancel(goal)

    def tick(self) -> None:
        """Handle timeouts; call it often."""
        now = self._clock.now_s()
        for goal in list(self._cancelled.values()):
            if now - goal.cancelled_s > FORGET_S:
                # If the server accepts the goal after all, `accepted` cancels it, because its token is unknown.
                del self._cancelled[goal.token]
            elif now - goal.cancel_sent_s >= CANCEL_REPEAT_S:
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
        # Perhaps only discovery lost the server, so the goal is cancelled like any other that is given up.
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
        """Handle the acceptance of a goal."""
        if token in self._cancelled:
            self._send_cancel(self._cancelled[token])
        elif not self.is_current(token):
            self._navigation.cancel(token)

    def feedback(self, token: int) -> None:
        """Handle feedback for a goal."""
        if self._goal is not None and self._goal.token == token:
            self._goal.feedback_s = self._clock.now_s()

    def rejected(self, token: int, detail: str = "nav_rejected") -> None:
        """Handle the rejection of a goal, or a failure to send it."""
        self._on_end(token, DriveResult("rejected", detail))

    def finished(self, token: int, status: int, sensors_lost: bool = False) -> None:
        """Handle the end of a goal with an action status; `sensors_lost` if it failed because lidar or odometry failed."""
        if sensors_lost and status not in (STATUS_SUCCEEDED, STATUS_CANCELED):
            result = DriveResult("sensors_lost", "nav_blind")
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
