"""The stop of the console's servers, each of which speaks for all its browsers.

A statement is JSON: `server` names the process, `engaged` tells whether one of its browsers holds the stop, `driving` whether
one is driving now, `presses` counts how often the stop was engaged there, and `releases` how often somebody released it on
purpose. By `presses` a stop is noticed that was engaged and released while the link was cut. The last statement stays valid: a
server that crashes neither releases a stop nor stops a mission. But a server that falls silent while a browser is driving
engages the stop, like a browser that is lost while it drives. A release on another server ends the stop of a silent one, unless
it may be older than that stop: the other server's count must have been heard since the silent one was heard last.
"""

from __future__ import annotations

from dataclasses import dataclass

from lupin_runtime.json_text import parse_json

EXPIRY_S = 1.5  # a server states its stop twice a second
HOLD_S = 1.5  # how long a stop is engaged whose statements did not arrive: a short one might be missed again
MAX_SERVERS = 32

# Reasons of a stop.
BROWSER_HOLDS_STOP = "a browser of the console holds the stop"
UNHEARD = "a browser of the console held the stop while the link was cut"
LOST = "the console was lost while a browser was driving: press and release its stop"
_UNKNOWN = ""  # the sender of a malformed statement


@dataclass
class _Server:
    heard_ns: int
    engaged: bool = False
    driving: bool = False
    lost: bool = False  # it fell silent while a browser was driving
    presses: int = 0
    releases: int = 0
    unheard_ns: int | None = None  # when it was noticed that a stop had not been heard


class ConsoleServerStop:
    """The servers' statements. Times are nanoseconds of real time."""

    def __init__(self) -> None:
        self._servers: dict[str, _Server] = {}

    def update(self, text: str, now_ns: int) -> bool:
        """Handle a statement; return whether it engages the stop. A malformed statement engages it, too."""
        self._expire(now_ns)
        try:
            statement = parse_json(text)
            name, presses, releases = statement["server"], statement["presses"], statement["releases"]
            engaged, driving = statement["engaged"], statement["driving"]
            flags_are_valid = isinstance(engaged, bool) and isinstance(driving, bool)
            if not (flags_are_valid and isinstance(name, str) and type(presses) is type(releases) is int):
                raise ValueError("not a statement")
        except (ValueError, KeyError, TypeError):
            name, engaged, driving, presses, releases = _UNKNOWN, True, False, 0, 0
        # What was pressed and released before a server was heard for the first time is past.
        server = self._servers.setdefault(name, _Server(now_ns, presses=presses, releases=releases))
        if releases > server.releases:
            self._release_silent(now_ns, server.heard_ns)
            server.lost = False
        is_unheard = presses > server.presses and not engaged
        if is_unheard:
            server.unheard_ns = now_ns
        server.heard_ns, server.engaged, server.driving = now_ns, engaged, driving
        server.presses, server.releases = presses, releases
        self._forget_oldest()
        return bool(engaged) or is_unheard

    def reason(self, now_ns: int) -> str | None:
        """Return why a server engages the stop, or None."""
        self._expire(now_ns)
        servers = self._servers.values()
        if any(server.lost for server in servers):
            return LOST
        if any(server.unheard_ns is not None and 0 <= now_ns - server.unheard_ns <= HOLD_S * 1e9 for server in servers):
            return UNHEARD
        return BROWSER_HOLDS_STOP if any(server.engaged for server in servers) else None

    def is_lost(self, now_ns: int) -> bool:
        """Return whether a stop is engaged that no server repeats, of which a new process would not hear."""
        self._expire(now_ns)
        servers = self._servers.values()
        return any(server.lost or (server.engaged and _is_silent(server, now_ns)) for server in servers)

    def _expire(self, now_ns: int) -> None:
        for server in self._servers.values():
            if server.driving and _is_silent(server, now_ns):
                server.driving, server.lost = False, True

    def _release_silent(self, now_ns: int, released_after_ns: int) -> None:
        for server in self._servers.values():
            if _is_silent(server, now_ns) and server.heard_ns <= released_after_ns:
                server.engaged = server.lost = False

    def _forget_oldest(self) -> None:
        released = [name for name, server in self._servers.items() if not (server.engaged or server.lost)]
        while len(self._servers) > MAX_SERVERS and released:
            del self._servers[min(released, key=lambda name: self._servers[name].heard_ns)]
            released = [name for name in released if name in self._servers]


def _is_silent(server: _Server, now_ns: int) -> bool:
    return now_ns - server.heard_ns > EXPIRY_S * 1e9
