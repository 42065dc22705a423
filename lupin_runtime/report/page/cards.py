"""The key figures at the top of the page."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from lupin_runtime.report.findings import clock
from lupin_runtime.report.report_json import ReportInput, figures
from lupin_runtime.twin.health import shown_state

MAX_TAG_ERROR_M, MAX_PATH_ERROR_M = 0.05, 0.05
MIN_REAL_TIME_FACTOR = 1.0 - 5e-3


@dataclass(frozen=True)
class Card:
    """One figure with a note below it; `css` marks good and bad values."""

    name: str
    value: str
    note: str = ""
    css: str = ""


def figure_cards(report: ReportInput) -> Iterable[Card]:
    """Yield the figures that are known."""
    n = figures(report)
    goal = n["score_tags_reachable"] or n["score_tags_total"]
    read_all = n["tags_read"] == n["tags_seen"]
    yield Card("Tags read", f"{n['tags_read']} of {n['tags_seen']}", "found by the robot", _rate(read_all))
    if goal and n["score_tags_found"] is not None:
        note = f"reachable; {n['score_tags_total']} in the world"
        yield Card("Tags found", f"{n['score_tags_found']} of {goal}", note, _rate(n["score_tags_found"] >= goal))
    if (error := n["score_tag_error_median_m"]) is not None:
        yield Card("Tag error", f"{error * 100:.1f} cm", "median, against the truth", _rate(error <= MAX_TAG_ERROR_M))
    if (error := n["score_trajectory_rmse_m"]) is not None:
        yield Card("Path error", f"{error * 100:.1f} cm", "RMSE, against the truth", _rate(error <= MAX_PATH_ERROR_M))
    if n["collisions"] is not None:
        yield Card("Collisions", f"{n['collisions']:.0f}", css=_rate(not n["collisions"]))
    if n["distance_m"]:
        yield Card("Driven", f"{n['distance_m']:.1f} m", "by odometry")
    yield Card("Mission" if report.log.mission_id else "Recorded", clock(n["mission_s"] or 0.0), "in ROS time")
    if n["flowers"] or n["bugs"]:
        pots = n["score_flowers_total"]
        right = f"; {n['score_flowers_right']} of {pots} pots right" if pots else ""
        yield Card("Flowers", str(n["flowers"]), f"bugs: {n['bugs']}{right}")
    if n["health"] != "no_data":
        health = shown_state(str(n["health"]), max((tag.worst_deviation for tag in report.tags), default=0.0))
        yield Card("Health", health.capitalize().replace("_", " "), "worst reading", f"health-{health}")
    if n["known_area_m2"]:
        yield Card("Mapped", f"{n['known_area_m2']:.0f} m²")
    if (factor := n["real_time_factor"]) is not None:
        yield Card("Real time", f"{factor:.2f}×", "of the simulation", _rate(factor >= MIN_REAL_TIME_FACTOR))
    if n["memory_mb"]:
        yield Card("Memory", f"{n['memory_mb']:.0f} MB", "all processes, peak")
    if n["ready_s"] is not None:
        yield Card("Ready in", f"{n['ready_s']:.1f} s", f"drivable in {n['drivable_s']:.1f} s" if n["drivable_s"] else "")


def _rate(good: bool) -> str:
    return "fine" if good else "off"
