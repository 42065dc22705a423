"""One goal at a time: sends goals, cancels them, survives lost answers; and takes the arm in before the robot moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from lupin_runtime.geometry import Pose2
from lupin_runtime.mission.ports import STATUS_CANCELED, STATUS_SUCCEEDED, STATUS_UNKNOWN, Arm, Clock, Navigation

CANCEL_WAIT_S = 3.0  # an acknowledgement that is lost must not strand what waits for it
CANCEL_REPEAT_S = 1.0
FORGET_S = 30.0
SERVER_LOST_S = 2.0  # discovery may blink; a server that is gone this long has taken its goal along
# A killed process stays discovered for its lease, 20 s, and its successor knows nothing of the goal. Navigation that works
# gives feedback many times a second; one that has begun to and is silent this long is not working on this goal.
FEEDBACK_SILENCE_S = 5.0
# Navigation stands still for some seconds before it gives a goal up for blind; it is asked again for about five minutes.
MAX_BLIND = 20
BLIND_WAIT_S = 5.0

End = Literal["succeeded", "canceled", "rejected", "failed", "lost", "blind"]


@dataclass(frozen=True)
class Outcome:
    """How a drive ended: `detail` is what a report says of it ("" after a success).

    `lost` went down with its server; `blind` was given up since lidar or odometry cannot be trusted: neither says anything
    of the goal.
    """

    end: End
    detail: str = ""


@dataclass
class _Flight:
    """A goal that was sent and has not ended."""

    token: int
    sent_s: float
    accepted: bool = False
    retired_s: float = 0.0
    cancel_sent_s: float | None = None
    feedback_s: float | None = None


class GoalRunner:
    """Keeps at most one goal that is wanted. A goal that is not wanted any more is cancelled, on acceptance if need be,
    and again until its end is heard; the next goal waits for that end, but no longer than CANCEL_WAIT_S.
    """

    def __init__(self, navigation: Navigation, clock: Clock) -> None:
        self._navigation, self._clock = navigation, clock
        self._token = 0
        self._flight: _Flight | None = None
        self._retired: dict[int, _Flight] = {}
        self._waiting: Pose2 | None = None
        self._done: Callable[[Outcome], None] = lambda outcome: None
        self._absent_since: float | None = None

    @property
    def busy(self) -> bool:
        """Whether a goal is under way, or about to be sent."""
        return self._flight is not None or self._waiting is not None

    @property
    def ending(self) -> bool:
        """Whether a cancelled goal has not reported its end yet."""
        return bool(self._retired)

    def request(self, pose: Pose2, done: Callable[[Outcome], None]) -> None:
        """Drive to a pose; `done` hears how it ended, unless it was cancelled from here. Replaces what is under way."""
        self.cancel()
        self._done = done
        self._waiting = pose
        self._send_waiting()

    def cancel(self) -> None:
        """Stop what is under way; its end is no longer reported to anyone."""
        self._waiting = None
        if self._flight is None:
            return
        flight, self._flight = self._flight, None
        flight.retired_s = self._clock.now_s()
        self._retired[flight.token] = flight
        if flight.accepted:
            self._cancel(flight)

    def tick(self) -> None:
        """Look after time-outs; call it often."""
        now = self._clock.now_s()
        for retired in list(self._retired.values()):
            if now - retired.retired_s > FORGET_S:
                # Should it be accepted after all, `accepted` does not know it and cancels it.
                del self._retired[retired.token]
            elif retired.accepted and now - (retired.cancel_sent_s or 0.0) >= CANCEL_REPEAT_S:
                self._cancel(retired)
        self._send_waiting()
        self._watch_server(now)
        flight = self._flight
        if flight is not None and flight.feedback_s is not None and now - flight.feedback_s >= FEEDBACK_SILENCE_S:
            self._lose("nav_silent")

    def _watch_server(self, now: float) -> None:
        if self._navigation.is_ready() or not (self._flight or self._retired):
            self._absent_since = None
            return
        if self._absent_since is None:
            self._absent_since = now
        elif now - self._absent_since >= SERVER_LOST_S and self._flight is not None:
            self._lose("nav_server_lost")

    def _lose(self, detail: str) -> None:
        # The server may only be out of sight: its goal is cancelled for as long as a cancelled one is remembered.
        self.cancel()
        self._done(Outcome("lost", detail))

    def _send_waiting(self) -> None:
        now = self._clock.now_s()
        ending = any(now - flight.retired_s < CANCEL_WAIT_S for flight in self._retired.values())
        if self._waiting is not None and not ending and self._navigation.is_ready():
            pose, self._waiting = self._waiting, None
            self._send(pose)

    def _send(self, pose: Pose2) -> None:
        self._token += 1
        self._flight = _Flight(self._token, self._clock.now_s())
        self._navigation.send(self._token, pose)

    def _cancel(self, flight: _Flight) -> None:
        flight.cancel_sent_s = self._clock.now_s()
        self._navigation.cancel(flight.token)

    def _end(self, outcome: Outcome) -> None:
        self._flight = None
        self._done(outcome)

    # -- what navigation says ------------------------------------------------------------------------------------------

    def accepted(self, token: int) -> None:
        """The server has taken a goal."""
        if self._flight is not None and self._flight.token == token:
            self._flight.accepted = True
        elif token in self._retired:
            self._retired[token].accepted = True
            self._cancel(self._retired[token])
        else:
            self._navigation.cancel(token)

    def feedback(self, token: int) -> None:
        """The server is working on a goal."""
        if self._flight is not None and self._flight.token == token:
            self._flight.feedback_s = self._clock.now_s()

    def rejected(self, token: int, detail: str = "nav_rejected") -> None:
        """The server has refused a goal, or sending it failed."""
        self._ended(token, Outcome("rejected", detail))

    def finished(self, token: int, status: int, blind: bool = False) -> None:
        """A goal has ended with an action status; `blind` says that the robot's senses failed, and not the goal."""
        if blind and status not in (STATUS_SUCCEEDED, STATUS_CANCELED):
            self._ended(token, Outcome("blind", "nav_blind"))
        elif status == STATUS_SUCCEEDED:
            self._ended(token, Outcome("succeeded"))
        elif status == STATUS_CANCELED:
            self._ended(token, Outcome("canceled", f"nav_status_{status}"))
        elif status == STATUS_UNKNOWN:  # a server that was restarted has never heard of the goal
            self._ended(token, Outcome("lost", f"nav_status_{status}"))
        else:
            self._ended(token, Outcome("failed", f"nav_status_{status}"))

    def _ended(self, token: int, outcome: Outcome) -> None:
        if self._flight is not None and self._flight.token == token:
            self._end(outcome)
            return
        self._retired.pop(token, None)
        self._send_waiting()


class Driver:
    """Drives to poses with the arm taken in: with patrol on, the travel preset is struck and given time before a goal
    leaves whenever the arm may be out."""

    def __init__(self, runner: GoalRunner, arm: Arm, clock: Clock, patrol: bool, travel_preset: str, settle_s: float) -> None:
        self._runner, self._arm, self._clock = runner, arm, clock
        self._patrol, self._travel_preset, self._settle_s = patrol, travel_preset, settle_s
        self._arm_out = patrol  # nobody knows where the arm is before the first drive
        self._settling: tuple[Pose2, Callable[[Outcome], None], float] | None = None
        self._started_s = 0.0

    @property
    def busy(self) -> bool:
        """Whether a drive is under way, the arm's settling included."""
        return self._settling is not None or self._runner.busy

    @property
    def age_s(self) -> float:
        """Seconds since the goal was sent, 0 while the arm settles."""
        return 0.0 if self._settling is not None else self._clock.now_s() - self._started_s

    def drive(self, pose: Pose2, done: Callable[[Outcome], None]) -> None:
        """Drive to a pose; `done` hears how it ended, unless `stop` was first."""
        if self._patrol and self._arm_out and self._arm.strike(self._travel_preset):
            self._settling = (pose, done, self._clock.now_s())
            self.tick()
            return
        self._go(pose, done)

    def strike(self, preset: str) -> None:
        """Move the arm while the robot stands."""
        if self._patrol:
            self._arm_out = self._arm.strike(preset) or self._arm_out

    def stop(self) -> None:
        """End the drive; nobody hears of it."""
        self._settling = None
        self._runner.cancel()

    def tick(self) -> None:
        """Look after the arm's settling."""
        if self._settling is not None:
            pose, done, since = self._settling
            if self._clock.now_s() - since >= self._settle_s:
                self._settling = None
                self._arm_out = False
                self._go(pose, done)

    def _go(self, pose: Pose2, done: Callable[[Outcome], None]) -> None:
        self._started_s = self._clock.now_s()
        self._runner.request(pose, done)
