"""The mission's codes in words: those of `last_error`, with their severity, and those of an observation's detail."""

from __future__ import annotations

from dataclasses import dataclass

INFO, WARN, ERROR = 0, 1, 2

LABELS: dict[str, tuple[int, str]] = {
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
NAVIGATION_RETRY = "navigation retry"

# Why a tag was not visited: explanations of details, by prefix.
EXPLANATIONS = {
    "nav_timeout": "the robot did not arrive before the navigation timeout",
    "nav_rejected": "navigation rejected the goal",
    "nav_unavailable": "navigation was not running",
    "nav_silent": "navigation did not answer",
    "nav_server_lost": "navigation ended during the drive",
    "nav_blind": "lidar or odometry failed for minutes, so the robot did not move",
    "nav_status_5": "the drive was cancelled",
    "nav_status_6": "the navigator gave up: no free path to the tag was found",
    "nav_status": "navigation ended without arriving",
    "amcl_drift_var": "the robot's pose was too uncertain",
    "no_pose": "the robot's pose was unknown",
    "send_goal_exception": "the goal could not be sent",
    "unknown_tag": "this tag's position is unknown",
    "visual_confirm_missed": "the camera did not see the tag from its standoff pose",
    "confirm_timeout": "the visual confirmation did not answer",
    "scan_timeout": "the greenhouse bridge did not answer",
    "bridge_status": "the greenhouse bridge refused the reading",
    "skipped_by_operator": "skipped by the operator",
    "mission_aborted": "the mission was aborted before its turn",
    "dock_unreachable": "the mission ended before its turn, because the dock was not reached",
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
        return EventLabel(code, WARN, NAVIGATION_RETRY)
    severity, label = LABELS.get(prefix, (WARN, code))
    return EventLabel(code, severity, label)


def explain(detail: str) -> str:
    """Explain an observation's detail; unknown text is returned unchanged."""
    prefix = max((code for code in EXPLANATIONS if detail.startswith(code)), key=len, default="")
    if not prefix:
        return detail
    rest = detail[len(prefix) :].lstrip("=: ")
    return f"{EXPLANATIONS[prefix]} ({rest})" if rest and not rest.startswith("_") else EXPLANATIONS[prefix]
