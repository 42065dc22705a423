"""Severity and label of the codes in `last_error`, for people."""

from __future__ import annotations

from dataclasses import dataclass

INFO, WARN, ERROR = 0, 1, 2

_LABELS: dict[str, tuple[int, str]] = {
    "battery_low": (WARN, "battery low"),
    "dock_unreachable": (WARN, "dock unreachable — paused"),
    "exploration_timeout": (WARN, "exploration timed out"),
    "estop_engaged": (WARN, "e-stop engaged"),
    "aborted_in_prepare": (WARN, "aborted during prepare"),
    "nav_blind": (WARN, "navigation has lost lidar or odometry"),
    "scan_failed": (WARN, "scan failed"),
    "robot_lost": (WARN, "robot lost on the map — waiting until it is found"),
    "robot_found": (INFO, "robot found on the map"),
    "robot_not_found": (ERROR, "robot lost on the map, and not found"),
    "localization_failed": (ERROR, "localization failed"),
    "dependency_timeout": (ERROR, "dependencies not ready"),
}


@dataclass(frozen=True)
class EventLabel:
    """A code with its text for people; `severity` is MissionState's (0 info, 1 warning, 2 error)."""

    code: str
    severity: int
    label: str


def label_event(code: str) -> EventLabel:
    """Look a code up by its part before the first `:` or space; the rest is detail.

    An unknown code becomes a warning labeled with the code itself.
    """
    if not code:
        return EventLabel("", INFO, "")
    prefix = code.replace(":", " ").split(" ", 1)[0]
    if prefix.startswith("nav_status_"):
        return EventLabel(code, WARN, "navigation retry")
    severity, label = _LABELS.get(prefix, (WARN, code))
    return EventLabel(code, severity, label)
