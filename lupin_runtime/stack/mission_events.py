"""What has happened in a mission, as its state messages tell, for the views of a run."""

from __future__ import annotations

from collections import deque
from typing import Any

MAX_EVENTS = 8


class MissionEvents:
    """What has happened in the mission, each with the mission's clock in seconds: the newest MAX_EVENTS."""

    def __init__(self) -> None:
        self.entries: deque[dict[str, Any]] = deque(maxlen=MAX_EVENTS)
        self._before: Any = None

    def note(self, message: Any) -> None:
        """Compare a MissionState message with the one before, and note what has changed."""
        before, self._before = self._before, message
        if before is None or before.mission_id != message.mission_id:
            self.entries.clear()
            if message.mission_id:
                self._add(message, "mission started")
            return
        target = before.current_target or message.current_target
        tag = f"tag {target}" if target else "a tag"  # tags that are read in passing, while exploring, are no targets
        if message.targets_completed > before.targets_completed:
            self._add(message, f"{tag} read")
        if message.targets_failed > before.targets_failed:
            self._add(message, f"{tag} not read: {message.last_event}")
        if message.targets_unreachable > before.targets_unreachable:
            self._add(message, f"{tag} unreachable: {message.last_event}")
        if message.tags_discovered > before.tags_discovered:
            self._add(message, f"{message.tags_discovered} tag{'s' if message.tags_discovered > 1 else ''} discovered")
        for name, on, off in (
            ("estop_engaged", "e-stop engaged", "e-stop released"),
            ("paused", "paused", "resumed"),
            ("battery_low", "battery low", "battery charged"),
        ):
            if getattr(message, name) != getattr(before, name):
                self._add(message, on if getattr(message, name) else off)
        if message.lifecycle_state != before.lifecycle_state:
            detail = f": {message.last_event}" if message.lifecycle_state == "FAULT" and message.last_event else ""
            self._add(message, message.lifecycle_state.lower() + detail)

    def _add(self, message: Any, text: str) -> None:
        self.entries.append({"clock_s": mission_clock_s(message), "text": text[:100]})


def mission_clock_s(message: Any) -> float | None:
    """Return the seconds since the mission's start, on the clock of its stamps; None before the first mission."""
    started_s, now_s = _seconds(message.started_at), _seconds(message.header.stamp)
    return round(max(0.0, now_s - started_s), 1) if started_s else None


def _seconds(stamp: Any) -> float:
    return float(stamp.sec + stamp.nanosec / 1e9)
