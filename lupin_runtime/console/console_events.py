"""The changes of stops and of control, by which it can be told afterwards why the robot stood still.

Each is decided in one place, the stop registry or the authority, and is described here. The command journal stores them.
"""

from __future__ import annotations

import enum
import math
import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

MAX_EVENTS = 200  # that browsers get; the journal has more


class EventKind(enum.Enum):
    """What has changed; the value is its name for browsers and in the journal."""

    STOP_PRESSED = "stop_pressed"
    STOP_LEFT = "stop_left"
    STOP_LOST_DRIVING = "stop_lost_driving"
    STOP_LOST_HOLDING = "stop_lost_holding"
    STOP_LOST_IN_CONTROL = "stop_lost_in_control"
    STOP_NOT_BACK = "stop_not_back"
    STOP_SILENT = "stop_silent"
    STOP_WITHDRAWN = "stop_withdrawn"
    STOP_RELEASED = "stop_released"
    CONTROL_TAKEN = "control_taken"
    CONTROL_TAKEN_OVER = "control_taken_over"
    CONTROL_REQUESTED = "control_requested"
    CONTROL_KEPT = "control_kept"
    CONTROL_UNANSWERED = "control_unanswered"
    CONTROL_REQUEST_WITHDRAWN = "control_request_withdrawn"
    CONTROL_PASSED = "control_passed"
    CONTROL_GIVEN_UP = "control_given_up"
    CONTROL_INHERITED = "control_inherited"
    CONTROL_LEFT = "control_left"
    CONTROL_EXPIRED = "control_expired"


_TEXTS = {
    EventKind.STOP_PRESSED: "{name} stopped the robot",
    EventKind.STOP_LEFT: "{name} stopped the robot",
    EventKind.STOP_LOST_DRIVING: "{name} was lost while it was driving: the robot was stopped",
    EventKind.STOP_LOST_HOLDING: "{name} was lost while it held the stop, which stays engaged",
    EventKind.STOP_LOST_IN_CONTROL: "{name} was lost while it had control: the robot was stopped",
    EventKind.STOP_NOT_BACK: "{name} connected again and did not repeat its state: the robot was stopped",
    EventKind.STOP_SILENT: "{name} was silent while it had control: the robot was stopped",
    EventKind.STOP_WITHDRAWN: "{name} let go of its stop",
    EventKind.STOP_RELEASED: "{name} released the stop of {other}",
    EventKind.CONTROL_TAKEN: "{name} has control",
    EventKind.CONTROL_TAKEN_OVER: "{name} has control, taken from {other}",
    EventKind.CONTROL_REQUESTED: "{name} asks {other} for control",
    EventKind.CONTROL_KEPT: "{name} kept control; {other} had asked for it",
    EventKind.CONTROL_UNANSWERED: "{name} asked for control and got no answer from {other}",
    EventKind.CONTROL_REQUEST_WITHDRAWN: "{name} no longer asks for control",
    EventKind.CONTROL_PASSED: "{name} handed control to {other}",
    EventKind.CONTROL_GIVEN_UP: "{name} gave up control",
    EventKind.CONTROL_INHERITED: "{name} has control, as it had asked: {other} no longer has it",
    EventKind.CONTROL_LEFT: "{name} left, so nobody has control",
    EventKind.CONTROL_EXPIRED: "{name} was silent and lost control",
}


@dataclass(frozen=True)
class ConsoleEvent:
    """A change of a stop or of control. `name` is the session that acted or was lost, `other` another that it concerns."""

    kind: EventKind
    name: str
    other: str = ""

    @property
    def text(self) -> str:
        """The event as a sentence."""
        return _TEXTS[self.kind].format(name=self.name, other=self.other)


@dataclass(frozen=True)
class NumberedEvent:
    """An event as browsers get it. `number` rises with every event of a run; `robot_s` is the time of the graph."""

    number: int
    robot_s: float
    kind: str
    name: str
    other: str

    def as_json(self) -> dict[str, Any]:
        """Return the event for browsers and for the journal."""
        return asdict(self)


class RecentEvents:
    """The last MAX_EVENTS events of the run. May be used on any thread."""

    def __init__(self, journal_rows: Sequence[Any] = ()) -> None:
        """`journal_rows` are those of an earlier console of the same run, whose events are taken over."""
        read = (_read(row.get("event")) for row in journal_rows if isinstance(row, dict))
        self._events = deque((event for event in read if event is not None), MAX_EVENTS)
        self._lock = threading.Lock()

    def add(self, event: ConsoleEvent, robot_s: float) -> NumberedEvent:
        """Number an event, and keep it."""
        with self._lock:
            number = self._events[-1].number + 1 if self._events else 1
            numbered = NumberedEvent(number, round(robot_s, 3), event.kind.value, event.name, event.other)
            self._events.append(numbered)
        return numbered

    def all(self) -> list[dict[str, Any]]:
        """Return the events, the oldest first."""
        with self._lock:
            return [event.as_json() for event in self._events]


def _read(value: Any) -> NumberedEvent | None:
    """The event of a journal's row; None if it has none, or a malformed one."""
    try:
        event = NumberedEvent(**value)
        number, robot_s = int(event.number), float(event.robot_s)
        texts = (str(event.kind), str(event.name), str(event.other))
    except (TypeError, ValueError, OverflowError):
        return None
    return NumberedEvent(number, robot_s, *texts) if math.isfinite(robot_s) else None
