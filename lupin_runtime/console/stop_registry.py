"""The stops of all clients, each a value of its own; together they are one console for the e-stop bridge.

A client that stops is stopped until it releases. One that disappears or falls silent while it drives, has control, or holds the
stop, leaves the stop engaged. The holder of the lease releases that by a stop and release of its own: a client that only
repeats that it is released releases nothing.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass

# A browser repeats its state twice a second.
EXPIRY_S = 1.5
# A velocity that is older does not mean that its sender is driving.
DRIVING_S = 0.5


@dataclass
class _ClientStop:
    name: str
    engaged: bool = False
    heard_ns: int | None = None  # its last statement; None for a client that never stated anything
    repeats: bool = False  # whether it repeats its statements, as consoles do: only of such a one silence says something
    moving_ns: int | None = None  # its last velocity that was not zero


class StopRegistry:
    """Combines the clients' stops. Times are monotonic nanoseconds."""

    def __init__(self) -> None:
        self._clients: dict[Hashable, _ClientStop] = {}
        self._lost: dict[str, str] = {}  # why a stop remains that no client holds any more, by the client's name

    def join(self, client: Hashable, name: str) -> None:
        """Add a client."""
        self._clients[client] = _ClientStop(name)

    def state(self, client: Hashable, engaged: bool, now_ns: int) -> None:
        """A client's own stop."""
        stop = self._clients[client]
        if stop.heard_ns is not None and engaged == stop.engaged and now_ns - stop.heard_ns <= EXPIRY_S * 1e9:
            stop.repeats = True
        stop.engaged, stop.heard_ns = engaged, now_ns

    def withdraw(self, client: Hashable, now_ns: int) -> None:
        """A client lets go of its stop and may not release it: the stop stays, and the holder of the lease releases it."""
        stop = self._clients[client]
        stop.engaged, stop.heard_ns = False, now_ns
        self._lost[stop.name] = f"{stop.name} stopped the robot"

    def hold_for(self, name: str) -> None:
        """Stop for somebody who has no connection that could hold the stop."""
        self._lost[name] = f"{name} stopped the robot"

    def velocity(self, client: Hashable, moving: bool, now_ns: int) -> bool:
        """A velocity that a client commands; `moving` where it is not zero. Returns whether the client was at rest before."""
        stop = self._clients[client]
        starts = moving and not _is_driving(stop, now_ns)
        stop.moving_ns = now_ns if moving else None
        return starts

    def is_driving(self, now_ns: int) -> bool:
        """Whether a client drives."""
        return any(_is_driving(stop, now_ns) for stop in self._clients.values())

    def end_driving(self, now_ns: int) -> bool:
        """Forget what clients drive, because another one takes over; returns whether one was driving."""
        driving = [stop for stop in self._clients.values() if _is_driving(stop, now_ns)]
        for stop in driving:
            stop.moving_ns = None
        return bool(driving)

    def leave(self, client: Hashable, now_ns: int, in_control: bool) -> bool:
        """Remove a client, which may be in control; returns whether it was driving."""
        stop = self._clients.pop(client, None)
        if stop is None:
            return False
        driving = _is_driving(stop, now_ns)
        if driving:
            self._lost[stop.name] = f"{stop.name} was lost while it was driving"
        elif stop.engaged:
            self._lost[stop.name] = f"{stop.name} was lost while it held the stop"
        elif in_control and stop.repeats:
            self._lost[stop.name] = f"{stop.name} was lost while it had control"
        return driving

    def holds(self, client: Hashable) -> bool:
        """Whether a client's own stop is engaged."""
        return self._clients[client].engaged

    def release_lost(self) -> None:
        """Release the stops that no client holds any more."""
        self._lost.clear()

    def tick(self, now_ns: int, in_control: str | None) -> None:
        """Engage for the console in control where it no longer repeats its state: nobody may be watching what it drives."""
        for stop in self._clients.values():
            silent = stop.repeats and stop.heard_ns is not None and now_ns - stop.heard_ns > EXPIRY_S * 1e9
            if silent and stop.name == in_control:
                self._lost.setdefault(stop.name, f"{stop.name} was silent for more than {EXPIRY_S:g} s")

    def reasons(self) -> list[str]:
        """Why the stop is engaged; empty where it is released."""
        held = [f"{stop.name} holds the stop" for stop in self._clients.values() if stop.engaged]
        return [*self._lost.values(), *held]


def _is_driving(stop: _ClientStop, now_ns: int) -> bool:
    return stop.moving_ns is not None and now_ns - stop.moving_ns <= DRIVING_S * 1e9
