"""What the codes in `last_error` mean to a person: severity and label."""

from __future__ import annotations

from dataclasses import dataclass

INFO, WARN, ERROR = 0, 1, 2

_LABELS: dict[str, tuple[int, str]] = {
    "battery_low": (WARN, "battery low"),
    "dock_unreachable": (WARN, "dock unreachable — paused"),
    "exploration_timeout": (WARN, "exploration timed out"),
    "estop_engaged": (WARN, "e-stop engaged"),
    "aborted_in_prepare": (WARN, "aborted during prepare"),
    "nav_blind": (WARN, "navigation is blind: lidar or odometry"),
    "scan_failed": (WARN, "scan failed"),
    "localization_failed": (ERROR, "localization failed"),
    "dependency_timeout": (ERROR, "dependencies not ready"),
}


@dataclass(frozen=True)
class Event:
    """A code as a person reads it; `severity` is MissionState's (0 info, 1 warning, 2 error)."""

    code: str
    severity: int
    label: str


def classify(code: str | None) -> Event:
    """The event of a raw code. What follows the first `:` or space is detail and does not decide; a code that the table
    does not know is a warning labelled with itself."""
    if not code:
        return Event("", INFO, "")
    prefix = code.replace(":", " ").split(" ", 1)[0]
    if prefix.startswith("nav_status_"):
        return Event(code, WARN, "navigation retry")
    severity, label = _LABELS.get(prefix, (WARN, code))
    return Event(code, severity, label)
