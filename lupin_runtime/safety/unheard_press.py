"""Presses of the e-stop that a node did not hear, because the link was cut or the node was suspended or being replaced.

The e-stop's state repeats, so its history is short: whoever hears nothing for some seconds may hear only "released" afterwards,
although somebody pressed the button meanwhile and expects that nothing moves without a newer command. `estop_bridge` therefore
counts its presses in its latched status.
"""

from __future__ import annotations

import uuid
from typing import Any

from lupin_runtime.json_text import parse_json

# A process that replaces another one takes over streams that the other one had stopped. It is up again within this time.
RECENT_S = 20.0
REPORTED_S = 60.0  # for this long after a release the bridge repeats its status, so that the age in it is never old
REPORT_PERIOD_S = 1.0


class PressCounter:
    """The bridge's count of its presses. Times are nanoseconds of the bridge's monotonic clock."""

    def __init__(self) -> None:
        self._bridge = uuid.uuid4().hex
        self._presses = 0
        self._is_engaged = False
        self._engaged_ns: int | None = None  # when the e-stop was last engaged

    def update(self, engaged: bool, now_ns: int) -> None:
        """Handle the e-stop's state, and count a press of whatever button or console."""
        self._presses += engaged and not self._is_engaged
        self._is_engaged = engaged
        if engaged:
            self._engaged_ns = now_ns

    def is_recent(self, now_ns: int) -> bool:
        """Return whether the e-stop was engaged within REPORTED_S, so that the status is to be repeated."""
        return self._engaged_ns is not None and now_ns - self._engaged_ns <= REPORTED_S * 1e9

    def report(self, now_ns: int) -> dict[str, Any]:
        """Return the part of the e-stop's status that UnheardPress reads: the bridge's process, its presses, the last one.

        That is an age, because a laptop's monotonic clock differs from the robot's.
        """
        ago_s = None if self._engaged_ns is None else round((now_ns - self._engaged_ns) / 1e9, 3)
        return {"bridge": self._bridge, "presses": self._presses, "engaged_s_ago": ago_s}


class UnheardPress:
    """Detects presses in the e-stop's status. Times are nanoseconds of the monotonic clock.

    The first status tells of the time before it: the e-stop counts as pressed if it was engaged since `since_ns`, by default
    within the last RECENT_S.
    """

    def __init__(self, since_ns: int | None = None) -> None:
        self._since_ns = since_ns
        self._bridge: str | None = None
        self._presses = 0

    def status(self, text: str, now_ns: int) -> bool:
        """Handle a status; return whether the e-stop was pressed since the last one, or recently before the first one.

        A status that is malformed, or of a bridge that counts nothing, tells nothing.
        """
        try:
            status = parse_json(text)
            bridge, presses, ago_s = status["bridge"], status["presses"], status["engaged_s_ago"]
        except (ValueError, KeyError, TypeError):
            return False
        if not isinstance(bridge, str) or type(presses) is not int or not isinstance(ago_s, (float, int, type(None))):
            return False
        is_first = self._bridge is None
        known = self._presses if bridge == self._bridge else 0
        self._bridge, self._presses = bridge, presses
        if is_first:
            since_ns = now_ns - int(RECENT_S * 1e9) if self._since_ns is None else self._since_ns
            return ago_s is not None and now_ns - ago_s * 1e9 >= since_ns
        return presses > known
