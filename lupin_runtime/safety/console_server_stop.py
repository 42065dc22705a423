"""The stop of the console's servers, each of which speaks for all its browsers.

A statement is JSON: `server` names the process, `engaged` is the stop of its browsers, `driving` tells whether one of them
drives now, and `releases` counts how often somebody released the stop there on purpose. The last statement holds: a server
that crashes neither releases a stop nor stops a mission. One that falls silent while a browser drives engages the stop, as
a browser that is lost while it drives does. What a silent server left is ended by a release on another one.
"""

from __future__ import annotations

import json
from dataclasses import dataclass

EXPIRY_S = 1.5  # a server states its stop twice a second
MAX_SERVERS = 32

HOLDS = "a browser of the console holds the stop"
LOST = "the console was lost while a browser was driving: press and release its stop"
_UNKNOWN = ""  # the sender of a malformed statement


@dataclass
class _Server:
    heard_ns: int
    engaged: bool = False
    driving: bool = False
    lost: bool = False  # it fell silent while a browser was driving
    releases: int = 0


class ConsoleServerStop:
    """The servers' statements. Times are nanoseconds of real time."""

    def __init__(self) -> None:
        self._servers: dict[str, _Server] = {}

    def update(self, text: str, now_ns: int) -> bool:
        """Handle a statement; returns whether it engages the stop. One that is malformed engages it, too."""
        self._expire(now_ns)
        try:
            statement = json.loads(text)
            name, releases = statement["server"], statement["releases"]
            engaged, driving = statement["engaged"], statement["driving"]
            flags_are_valid = isinstance(engaged, bool) and isinstance(driving, bool)
            if not (flags_are_valid and isinstance(name, str) and type(releases) is int):
                raise ValueError("not a statement")
        except (ValueError, KeyError, TypeError):
            name, engaged, driving, releases = _UNKNOWN, True, False, 0
        server = self._servers.setdefault(name, _Server(now_ns))
        if releases > server.releases:
            self._release_silent(now_ns)
            server.lost = False
        server.heard_ns, server.engaged, server.driving, server.releases = now_ns, engaged, driving, releases
        self._forget_oldest()
        return bool(engaged)

    def reason(self, now_ns: int) -> str | None:
        """Why a server engages the stop; None while none does."""
        self._expire(now_ns)
        servers = self._servers.values()
        if any(server.lost for server in servers):
            return LOST
        return HOLDS if any(server.engaged for server in servers) else None

    def _expire(self, now_ns: int) -> None:
        for server in self._servers.values():
            if server.driving and now_ns - server.heard_ns > EXPIRY_S * 1e9:
                server.driving, server.lost = False, True

    def _release_silent(self, now_ns: int) -> None:
        for server in self._servers.values():
            if now_ns - server.heard_ns > EXPIRY_S * 1e9:
                server.engaged = server.lost = False

    def _forget_oldest(self) -> None:
        released = [name for name, server in self._servers.items() if not (server.engaged or server.lost)]
        while len(self._servers) > MAX_SERVERS and released:
            del self._servers[min(released, key=lambda name: self._servers[name].heard_ns)]
            released = [name for name in released if name in self._servers]
