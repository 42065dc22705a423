"""The stops of all clients. Each client has its own; for the e-stop bridge they are combined into one.

A client that engages its stop holds it until it releases it. A client that disconnects while it drives, has control or holds
its stop leaves the stop engaged, and so does the client in control if it falls silent. The client in control releases such a
lost stop by engaging and releasing its own: a client that only repeats "released" releases nothing.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass

SILENCE_TIMEOUT_S = 1.5  # pages repeat the state of their stop twice a second
# A page that has connected again first learns who has control, on a channel that it retries after 1.5 s, and then repeats its
# state twice.
RETURN_TIMEOUT_S = 3.0
DRIVING_S = 0.5  # a client counts as driving for this long after its last velocity that was not zero


@dataclass
class _ClientStop:
    name: str
    engaged: bool = False
    heard_ns: int | None = None  # when it last sent the state of its stop; None if never
    repeats: bool = False  # whether it repeats that state, as pages do; the silence of any other client means nothing
    moving_ns: int | None = None  # when it last sent a velocity that was not zero


class StopRegistry:
    """Combines the clients' stops. Times are monotonic nanoseconds."""

    def __init__(self) -> None:
        self._clients: dict[Hashable, _ClientStop] = {}
        self._lost: dict[str, str] = {}  # by client name: why a stop is engaged that no client holds any more
        self._due_ns: dict[str, int] = {}  # by client name: until when one of its clients must repeat its state again

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

    def set_stop(self, client: Hashable, engaged: bool, now_ns: int) -> None:
        """Engage or release a client's own stop."""
        stop = self._clients[client]
        if stop.heard_ns is not None and engaged == stop.engaged and now_ns - stop.heard_ns <= SILENCE_TIMEOUT_S * 1e9:
            stop.repeats = True
            self._due_ns.pop(stop.name, None)
        stop.engaged, stop.heard_ns = engaged, now_ns

    def withdraw(self, client: Hashable, now_ns: int) -> None:
        """Turn the stop of a client that no longer holds it, but may not release it, into a lost one."""
        stop = self._clients[client]
        stop.engaged, stop.heard_ns = False, now_ns
        self._lost[stop.name] = f"{stop.name} stopped the robot"

    def hold_for(self, name: str) -> None:
        """Engage a stop for a session that has no connection to hold it."""
        self._lost[name] = f"{name} stopped the robot"

    def note_velocity(self, client: Hashable, moving: bool, now_ns: int) -> bool:
        """Note a client's velocity, which is zero unless `moving`. Return whether the client starts to drive with it."""
        stop = self._clients[client]
        is_start = moving and not _is_driving(stop, now_ns)
        stop.moving_ns = now_ns if moving else None
        return is_start

    def is_driving(self, now_ns: int) -> bool:
        """Return whether any client is driving."""
        return any(_is_driving(stop, now_ns) for stop in self._clients.values())

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
            self._lost[stop.name] = f"{stop.name} was lost while it was driving"
        elif stop.engaged:
            self._lost[stop.name] = f"{stop.name} was lost while it held the stop"
        elif in_control and not self._is_watched(stop.name, now_ns) and (stop.repeats or self._is_last_of_due(stop.name)):
            self._due_ns.pop(stop.name, None)
            self._lost[stop.name] = f"{stop.name} was lost while it had control"
        return driving

    def holds(self, client: Hashable) -> bool:
        """Return whether a client's own stop is engaged."""
        return self._clients[client].engaged

    def release_lost(self) -> None:
        """Release all lost stops, those that no client holds any more."""
        self._lost.clear()

    def check_silence(self, now_ns: int, in_control: str | None) -> None:
        """Engage the stop if no client of the session in control repeats its state any more: nobody may be watching the robot.

        Of several tabs of a browser only the one that commands repeats it; another tab may have taken over.
        """
        self._due_ns = {name: due_ns for name, due_ns in self._due_ns.items() if name == in_control}
        if in_control is not None and now_ns > self._due_ns.get(in_control, now_ns):
            del self._due_ns[in_control]
            self._lost.setdefault(in_control, f"{in_control} has not repeated its state since it connected again")
        repeated = any(stop.repeats and stop.name == in_control for stop in self._clients.values())
        if in_control is not None and repeated and not self._is_watched(in_control, now_ns):
            self._lost.setdefault(in_control, f"{in_control} was silent for more than {SILENCE_TIMEOUT_S:g} s")

    def _is_watched(self, name: str, now_ns: int) -> bool:
        """Return whether a client of this name repeats its state."""
        stops = (stop for stop in self._clients.values() if stop.name == name and stop.repeats)
        return any(stop.heard_ns is not None and now_ns - stop.heard_ns <= SILENCE_TIMEOUT_S * 1e9 for stop in stops)

    def _is_last_of_due(self, name: str) -> bool:
        """Return whether a client of this name must repeat its state again, but none is left."""
        return name in self._due_ns and all(stop.name != name for stop in self._clients.values())

    def reasons(self) -> list[str]:
        """Return why the stop is engaged; empty if it is not."""
        held = [f"{stop.name} holds the stop" for stop in self._clients.values() if stop.engaged]
        return [*self._lost.values(), *held]


def _is_driving(stop: _ClientStop, now_ns: int) -> bool:
    return stop.moving_ns is not None and now_ns - stop.moving_ns <= DRIVING_S * 1e9
