"""Presses of the e-stop that a node did not hear, because the link was cut or the node was suspended or being replaced.

The e-stop's state repeats, so its history is short: whoever hears nothing for some seconds may hear only "released" afterwards,
although somebody pressed the button meanwhile and expects that nothing moves without a newer command. `estop_bridge` therefore
counts its presses in its latched status.
"""

from __future__ import annotations

import json
import uuid
from typing import Any

# A process that replaces another one takes over streams that the other one had stopped. It is up again within this time.
RECENT_PRESS_S = 20.0


class PressCounter:
    """The bridge's count of its presses. Times are nanoseconds of the monotonic clock."""

    def __init__(self) -> None:
        self._bridge = uuid.uuid4().hex
        self._presses = 0
        self._pressed_ns: int | None = None

    def count(self, now_ns: int) -> None:
        """Count a press, of whatever button or console."""
        self._presses += 1
        self._pressed_ns = now_ns

    def report(self) -> dict[str, Any]:
        """Return the part of the e-stop's status that UnheardPress reads: the bridge's process, its presses, the last one."""
        return {"bridge": self._bridge, "presses": self._presses, "pressed_ns": self._pressed_ns}


class UnheardPress:
    """Detects presses in the e-stop's status. Times are nanoseconds of the monotonic clock."""

    def __init__(self) -> None:
        self._bridge: str | None = None
        self._presses = 0

    def status(self, text: str, now_ns: int) -> bool:
        """Handle a status; return whether the e-stop was pressed since the last one, or shortly before the first one.

        A status that is malformed, or of a bridge that counts nothing, tells nothing.
        """
        try:
            status = json.loads(text)
            bridge, presses, pressed_ns = status["bridge"], status["presses"], status["pressed_ns"]
        except (ValueError, KeyError, TypeError):
            return False
        if not isinstance(bridge, str) or type(presses) is not int or not (pressed_ns is None or type(pressed_ns) is int):
            return False
        is_first = self._bridge is None
        known = self._presses if bridge == self._bridge else 0
        self._bridge, self._presses = bridge, presses
        if is_first:
            return pressed_ns is not None and 0 <= now_ns - pressed_ns <= RECENT_PRESS_S * 1e9
        return presses > known
