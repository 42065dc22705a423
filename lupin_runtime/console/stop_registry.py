"""The stops of all clients, each a value of its own; together they are one console for the e-stop bridge.

A client that stops is stopped until it releases. One that disappears while it drives, or while it holds the stop, leaves the
stop engaged, and the holder of the lease releases it.
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
    moving_ns: int | None = None  # its last velocity that was not zero


class StopRegistry:
    """Combines the clients' stops. Times are monotonic nanoseconds."""

    def __init__(self) -> None:
        self._clients: dict[Hashable, _ClientStop] = {}
        self._lost: dict[str, str] = {}  # why the stop of a client that is gone remains, by its name

    def join(self, client: Hashable, name: str) -> None:
        """Add a client."""
        self._clients[client] = _ClientStop(name)

    def state(self, client: Hashable, engaged: bool, now_ns: int) -> None:
        """A client's own stop."""
        stop = self._clients[client]
        stop.engaged, stop.heard_ns = engaged, now_ns

    def velocity(self, client: Hashable, moving: bool, now_ns: int) -> None:
        """A velocity that a client commands; `moving` where it is not zero."""
        self._clients[client].moving_ns = now_ns if moving else None

    def leave(self, client: Hashable, now_ns: int, in_control: bool) -> bool:
        """Remove a client, which may be the console that is in control; returns whether it was driving."""
        stop = self._clients.pop(client, None)
        if stop is None:
            return False
        driving = stop.moving_ns is not None and now_ns - stop.moving_ns <= DRIVING_S * 1e9
        if driving:
            self._lost[stop.name] = f"{stop.name} was lost while it was driving"
        elif stop.engaged:
            self._lost[stop.name] = f"{stop.name} was lost while it held the stop"
        elif in_control:
            self._lost[stop.name] = f"{stop.name} was lost while it had control"
        return driving

    def is_engaged(self, client: Hashable, now_ns: int) -> bool:
        """Whether a release by this client would change anything: its own stop, or one that a lost client left."""
        stop = self._clients[client]
        silent = stop.heard_ns is not None and now_ns - stop.heard_ns > EXPIRY_S * 1e9
        return stop.engaged or silent or bool(self._lost)

    def release_lost(self) -> None:
        """Release the stops of clients that are gone."""
        self._lost.clear()

    def reasons(self, now_ns: int) -> list[str]:
        """Why the stop is engaged; empty where it is released."""
        found = list(self._lost.values())
        for stop in self._clients.values():
            if stop.engaged:
                found.append(f"{stop.name} holds the stop")
            elif stop.heard_ns is not None and now_ns - stop.heard_ns > EXPIRY_S * 1e9:
                found.append(f"{stop.name} is silent for more than {EXPIRY_S:g} s")
        return found
