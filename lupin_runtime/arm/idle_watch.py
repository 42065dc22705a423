"""Decides whether somebody uses the arm, from its status, the library's state and the mission's. Times are monotonic ns."""

from __future__ import annotations

from typing import Any

from lupin_runtime import graph
from lupin_runtime.json_text import conform, parse_json

IDLE_S = 2.0  # for which nobody must have used the arm
LISTEN_S = 10.0  # until a mission's state must have arrived if there is a mission: that of another computer takes so long
SILENT_S = 3.0  # after which a status counts no more; it is repeated every second
RESTING = ("", "BOOT", "READY", "DONE", "FAULT")  # lifecycle states of a mission that does not use the arm

# The program runs on the robot, or with `lupin home --local` in a run of this computer.
_BODY_LOG = "journalctl -u lupin-onboard, or of a run on this computer: lupin logs body"

_STATUS = {"holder": "", "moving": False, "limp": False}
_LIBRARY = {"recording": False, "playing": False, "name": ""}


class IdleWatch:
    """Follows who uses the arm."""

    def __init__(self, now_ns: int) -> None:
        self._began_ns = self._busy_ns = now_ns  # when the arm was last in use
        self._has_heard_mission = False
        self._status_ns: int | None = None
        self._reasons: dict[str, tuple[str, int]] = {}  # by topic: why the arm is in use, and when that was said

    def status(self, text: str, now_ns: int) -> None:
        """Handle a message of `/lupin/arm/status`. Raises ValueError for text that is not JSON."""
        status = conform(parse_json(text), _STATUS)
        self._status_ns = now_ns
        reason = f"it is reserved: {status['holder']}" if status["holder"] else "it moves" if status["moving"] else ""
        self._note(graph.ARM_STATUS.name, reason or ("it is limp" if status["limp"] else ""), now_ns)

    def library(self, text: str, now_ns: int) -> None:
        """Handle a message of the library's state. Raises ValueError for text that is not JSON."""
        state: dict[str, Any] = conform(parse_json(text), _LIBRARY)
        activity = "recording" if state["recording"] else "playing" if state["playing"] else ""
        self._note(graph.ARM_LIBRARY_STATE.name, activity and f"the library is {activity} {state['name']}".rstrip(), now_ns)

    def mission(self, lifecycle: str, now_ns: int) -> None:
        """Handle the lifecycle state of a mission."""
        self._has_heard_mission = True
        reason = "" if lifecycle in RESTING else f"a mission is {lifecycle}"
        self._note(graph.MISSION_STATE.name, reason, now_ns)

    def reason(self, now_ns: int) -> str:
        """Return why the arm is not idle; empty if nobody has used it for IDLE_S."""
        if self._status_ns is None or now_ns - self._status_ns > SILENT_S * 1e9:
            self._busy_ns = now_ns
            return f"{graph.ARM_STATUS.name} is not received; see {_BODY_LOG}"
        for reason, said_ns in self._reasons.values():
            if reason and now_ns - said_ns <= SILENT_S * 1e9:
                self._busy_ns = now_ns
                return reason
        if not self._has_heard_mission and now_ns - self._began_ns < LISTEN_S * 1e9:
            return "a mission may be in progress whose state has not arrived yet"
        return "" if now_ns - self._busy_ns >= IDLE_S * 1e9 else "it was in use just now"

    def _note(self, topic: str, reason: str, now_ns: int) -> None:
        self._reasons[topic] = reason, now_ns
