"""The stops of all clients. Each client has its own; for the e-stop bridge they are combined into one.

A client that engages its stop holds it until it lets go of it, or until whoever has control releases it, having seen whose it
is. A client that disconnects while it drives, has control or holds its stop leaves the stop engaged, and so does the client in
control if it falls silent. Whoever has control releases such a lost stop, too.

A page repeats its stop, and names each press. A press that somebody else has released is over: the page that goes on repeating
it is told so, also after it has connected again. The next press has another name. Programs name no presses: what they repeat
after a release engages the stop again.
"""

from __future__ import annotations

import enum
import uuid
from collections import deque
from collections.abc import Collection, Hashable
from dataclasses import dataclass
from typing import Any

from lupin_runtime.console.console_events import ConsoleEvent, EventKind

SILENCE_TIMEOUT_S = 1.5  # pages repeat the state of their stop twice a second
# A page that has connected again first learns who has control, on a channel that it retries after 1.5 s, and then repeats its
# state twice.
RETURN_TIMEOUT_S = 3.0
DRIVING_S = 0.5  # a client counts as driving for this long after its last velocity that was not zero
PRESS_PREFIX = "press:"  # of the names that pages give their presses; other clients number their messages
_MAX_PRESS = 100  # characters
MAX_OVERRULED = 256  # presses that were released by others and may still be repeated
_MAX_EVENTS = 1000  # that have not been taken yet


class HoldKind(enum.Enum):
    """How a stop came about; the value is its name for browsers."""

    PRESSED = "pressed"
    LEFT = "left"
    LOST_DRIVING = "lost_driving"
    LOST_HOLDING = "lost_holding"
    LOST_IN_CONTROL = "lost_in_control"
    NOT_BACK = "not_back"
    SILENT = "silent"


TEXTS = {
    HoldKind.PRESSED: "{} holds the stop",
    HoldKind.LEFT: "{} stopped the robot",
    HoldKind.LOST_DRIVING: "{} was lost while it was driving",
    HoldKind.LOST_HOLDING: "{} was lost while it held the stop",
    HoldKind.LOST_IN_CONTROL: "{} was lost while it had control",
    HoldKind.NOT_BACK: "{} has not repeated its state since it connected again",
    HoldKind.SILENT: "{} was silent for more than " + f"{SILENCE_TIMEOUT_S:g} s",
}


@dataclass(frozen=True)
class StopHold:
    """What engages the stop: the press of a client, or its loss. `press` identifies it, `name` is the client's session."""

    press: str
    name: str
    kind: HoldKind
    since_ns: int

    @property
    def text(self) -> str:
        """The reason as text."""
        return TEXTS[self.kind].format(self.name)


@dataclass
class _ClientStop:
    name: str
    hold: StopHold | None = None  # its own stop while that is engaged
    heard_ns: int | None = None  # when it last sent the state of its stop; None if never
    repeats: bool = False  # whether it repeats that state, as pages do; the silence of any other client means nothing
    moving_ns: int | None = None  # when it last sent a velocity that was not zero


class StopRegistry:
    """Combines the clients' stops. Times are monotonic nanoseconds."""

    def __init__(self) -> None:
        self._clients: dict[Hashable, _ClientStop] = {}
        self._lost: dict[str, StopHold] = {}  # by client name: the stop that no client holds any more
        self._due_ns: dict[str, int] = {}  # by client name: until when one of its clients must repeat its state again
        self._overruled: dict[str, str] = {}  # by press: who has released it for somebody else
        self._events: deque[ConsoleEvent] = deque(maxlen=_MAX_EVENTS)

    def take_events(self) -> list[ConsoleEvent]:
        """Return what has changed since the last call, the oldest first. To be called once the stop was published."""
        events, self._events = list(self._events), deque(maxlen=_MAX_EVENTS)
        return events

    def join(self, client: Hashable, name: str, now_ns: int) -> None:
        """Add a client. Others of this name must show again that they repeat their state: a page that has connected again after
        its network was cut must not be stopped by the silence of its dead connection. One of them must do so within
        RETURN_TIMEOUT_S, which further clients do not prolong.
        """
        for stop in self._clients.values():
            if stop.name == name and stop.repeats:
                stop.repeats = False
                self._due_ns.setdefault(name, now_ns + int(RETURN_TIMEOUT_S * 1e9))
        self._clients[client] = _ClientStop(name)

    def set_stop(self, client: Hashable, engaged: bool, now_ns: int, press: str = "") -> str:
        """Engage a client's own stop, or let go of it. `press` is the client's name for it, empty if it has none.

        Returns who has released this press meanwhile, so that it is not engaged again; otherwise an empty text.
        """
        stop = self._clients[client]
        overruled_by = self._overruled.get(press, "") if engaged else ""
        engaged = engaged and not overruled_by
        is_same = engaged == (stop.hold is not None)
        if stop.heard_ns is not None and is_same and now_ns - stop.heard_ns <= SILENCE_TIMEOUT_S * 1e9:
            stop.repeats = True
            self._due_ns.pop(stop.name, None)
        stop.heard_ns = now_ns
        lost = self._lost.get(stop.name)
        is_lost_press = press != "" and lost is not None and lost.press == press
        if not engaged:
            if stop.hold is not None or is_lost_press:
                self._events.append(ConsoleEvent(EventKind.STOP_WITHDRAWN, stop.name))
            stop.hold = None
            if is_lost_press:
                del self._lost[stop.name]  # the same press, which reached the server in another way, too
        elif stop.hold is None or press not in ("", stop.hold.press):
            if not is_lost_press:
                self._events.append(ConsoleEvent(EventKind.STOP_PRESSED, stop.name))
            stop.hold = StopHold(press or _new_press(), stop.name, HoldKind.PRESSED, now_ns)
        return overruled_by

    def hold_for(self, name: str, now_ns: int, press: str = "") -> None:
        """Engage a stop for a session that has no connection to hold it."""
        self._lose(name, HoldKind.LEFT, now_ns, press)

    def note_velocity(self, client: Hashable, moving: bool, now_ns: int) -> bool:
        """Note a client's velocity, which is zero unless `moving`. Return whether the client starts to drive with it."""
        stop = self._clients[client]
        is_start = moving and not _is_driving(stop, now_ns)
        stop.moving_ns = now_ns if moving else None
        return is_start

    def is_driving(self, now_ns: int, except_for: Hashable | None = None) -> bool:
        """Return whether any client is driving, or any but one."""
        return any(_is_driving(stop, now_ns) for client, stop in self._clients.items() if client is not except_for)

    def end_driving(self, now_ns: int) -> bool:
        """Forget the velocities of all clients, because control has changed. Return whether a client was driving."""
        driving = [stop for stop in self._clients.values() if _is_driving(stop, now_ns)]
        for stop in driving:
            stop.moving_ns = None
        return bool(driving)

    def leave(self, client: Hashable, now_ns: int, in_control: bool) -> bool:
        """Remove a client, keeping its stop engaged if the robot must not go on without it. Return whether it was driving."""
        stop = self._clients.pop(client, None)
        if stop is None:
            return False
        driving = _is_driving(stop, now_ns)
        if driving:
            self._lose(stop.name, HoldKind.LOST_DRIVING, now_ns)
        elif stop.hold is not None:
            self._lose(stop.name, HoldKind.LOST_HOLDING, stop.hold.since_ns, stop.hold.press)
        elif in_control and not self._is_watched(stop.name, now_ns) and (stop.repeats or self._is_last_of_due(stop.name)):
            self._due_ns.pop(stop.name, None)
            self._lose(stop.name, HoldKind.LOST_IN_CONTROL, now_ns)
        return driving

    def holds(self, client: Hashable) -> bool:
        """Return whether a client's own stop is engaged."""
        return self._clients[client].hold is not None

    def release_lost(self, by: str) -> None:
        """Release all lost stops, those that no client holds any more."""
        self._events.extend(ConsoleEvent(EventKind.STOP_RELEASED, by, hold.name) for hold in self._lost.values())
        self._lost.clear()

    def withdraw(self, press: str, name: str) -> bool:
        """Let go of a stop that a session engaged itself and no client of it holds. Return False if there is none."""
        hold = self._lost.get(name)
        if hold is None or hold.kind not in (HoldKind.LEFT, HoldKind.LOST_HOLDING) or hold.press != press:
            return False
        del self._lost[name]
        self._events.append(ConsoleEvent(EventKind.STOP_WITHDRAWN, name))
        return True

    def release(self, presses: Collection[str], by: str) -> None:
        """Release the stops of these presses, whoever holds them, for a session that has seen them."""
        released = {hold.press: hold.name for hold in self.reasons() if hold.press in presses}
        self._overruled |= dict.fromkeys(released, by)
        self._events.extend(ConsoleEvent(EventKind.STOP_RELEASED, by, name) for name in released.values())
        self._lost = {name: hold for name, hold in self._lost.items() if hold.press not in presses}
        for stop in self._clients.values():
            if stop.hold is not None and stop.hold.press in presses:
                stop.hold = None
        for press in list(self._overruled)[:-MAX_OVERRULED]:
            del self._overruled[press]

    def check_silence(self, now_ns: int, in_control: str | None, since_ns: int = 0) -> None:
        """Engage the stop if no client of the session in control repeats its state any more: nobody may be watching the robot.

        Of several tabs of a browser only the one that commands repeats it; another tab may have taken over. A session that got
        control at `since_ns` need not have repeated anything before: pages repeat their state while they have control.
        """
        self._due_ns = {name: due_ns for name, due_ns in self._due_ns.items() if name == in_control}
        if in_control is not None and now_ns > self._due_ns.get(in_control, now_ns):
            del self._due_ns[in_control]
            if in_control not in self._lost:
                self._lose(in_control, HoldKind.NOT_BACK, now_ns)
        repeated = any(stop.repeats and stop.name == in_control for stop in self._clients.values())
        if in_control is None or not repeated or in_control in self._lost:
            return
        is_new = now_ns - since_ns <= SILENCE_TIMEOUT_S * 1e9
        if not is_new and not self._is_watched(in_control, now_ns):
            self._lose(in_control, HoldKind.SILENT, now_ns)

    def _lose(self, name: str, kind: HoldKind, since_ns: int, press: str = "") -> None:
        before = self._lost.get(name)
        self._lost[name] = StopHold(press or _new_press(), name, kind, since_ns)
        if before is None or (before.kind, press) != (kind, before.press):
            self._events.append(ConsoleEvent(EventKind(f"stop_{kind.value}"), name))

    def _is_watched(self, name: str, now_ns: int) -> bool:
        """Return whether a client of this name repeats its state."""
        stops = (stop for stop in self._clients.values() if stop.name == name and stop.repeats)
        return any(stop.heard_ns is not None and now_ns - stop.heard_ns <= SILENCE_TIMEOUT_S * 1e9 for stop in stops)

    def _is_last_of_due(self, name: str) -> bool:
        """Return whether a client of this name must repeat its state again, but none is left."""
        return name in self._due_ns and all(stop.name != name for stop in self._clients.values())

    def reasons(self) -> list[StopHold]:
        """Return what engages the stop; empty if nothing does."""
        return [*self._lost.values(), *(stop.hold for stop in self._clients.values() if stop.hold is not None)]


def press_name(identifier: Any) -> str:
    """Return the name of a press from a client's message; empty if it has none, whatever else it has."""
    is_name = isinstance(identifier, str) and identifier.startswith(PRESS_PREFIX) and len(identifier) <= _MAX_PRESS
    return identifier if is_name else ""


def _new_press() -> str:
    return uuid.uuid4().hex


def _is_driving(stop: _ClientStop, now_ns: int) -> bool:
    return stop.moving_ns is not None and now_ns - stop.moving_ns <= DRIVING_S * 1e9
