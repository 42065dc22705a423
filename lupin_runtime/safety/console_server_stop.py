"""The stop of the console's server, which speaks for all its browsers.

Its statements are JSON: `engaged` is true, false, or null where this server process has not been told yet, and `driving` tells
whether a browser drives now. The last statement holds: a server that crashes neither releases a stop nor stops a mission. One
that falls silent while a browser drives engages the stop, as a browser that is lost while it drives does.
"""

from __future__ import annotations

import json

EXPIRY_S = 1.5  # it states its stop twice a second

HOLDS = "a browser of the console holds the stop"
LOST = "the console was lost while a browser was driving: press and release its stop"


class ConsoleServerStop:
    """The server's statements. Times are nanoseconds of real time."""

    def __init__(self) -> None:
        self._engaged = False
        self._driving_ns: int | None = None
        self._lost = False

    def update(self, text: str, now_ns: int) -> bool:
        """Handle a statement; returns whether it engages the stop. One that is malformed engages it, too."""
        self._expire(now_ns)
        try:
            statement = json.loads(text)
            engaged, driving = statement["engaged"], statement["driving"]
            if engaged not in (True, False, None) or not isinstance(driving, bool):
                raise ValueError("expected engaged and driving")
        except (ValueError, KeyError, TypeError):
            engaged, driving = True, False
        if engaged is not None:
            self._engaged = engaged
            self._lost = self._lost and engaged
        self._driving_ns = now_ns if driving else None
        return self._engaged

    def reason(self, now_ns: int) -> str | None:
        """Why the server engages the stop; None while it does not."""
        self._expire(now_ns)
        if self._lost:
            return LOST
        return HOLDS if self._engaged else None

    def _expire(self, now_ns: int) -> None:
        if self._driving_ns is not None and now_ns - self._driving_ns > EXPIRY_S * 1e9:
            self._driving_ns, self._lost = None, True
