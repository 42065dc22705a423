"""What a run knows of each tag at its end, gathered from perception, the mission's observations and the twin."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from lupin_runtime.report.health import deviation, health
from lupin_runtime.report.log import FlowerLook, Point, RunLog, Seen, TagPose

READ, UNREACHABLE, SCAN_FAILED, SKIPPED, SEEN_ONLY = "read", "unreachable", "scan_failed", "skipped", "seen"

# Tags are read on discovery too, over the bridge and from afar: that observation names the exploration, not a visit.
_VISITS = ("InspectionMission", "MonitoringMission")

# What a mission's detail code means, by its beginning.
REASONS = {
    "nav_timeout": "the robot did not arrive within the time for one leg",
    "nav_rejected": "the navigator refused the goal",
    "nav_blind": "lidar or odometry could not be trusted for minutes, so the robot stood still",
    "nav_status_5": "the leg was cancelled",
    "nav_status_6": "the navigator gave up: no free way to the tag was found",
    "nav_status": "navigation ended without arriving",
    "amcl_drift_var": "the robot was not sure enough where it is",
    "no_pose": "the robot did not know where it is",
    "send_goal_exception": "the goal could not be sent",
    "unknown_tag": "no pose of this tag is known",
    "visual_confirm_missed": "the camera did not see the tag from its standoff pose",
    "confirm_timeout": "the visual confirmation did not answer",
    "scan_timeout": "the greenhouse did not answer",
    "bridge_status": "the greenhouse refused the reading",
    "skipped_by_operator": "skipped by the operator",
    "mission_aborted": "the mission was aborted before its turn",
}


@dataclass(frozen=True)
class Reading:
    """The latest value of a sensor."""

    sensor: str
    value: float
    t_s: float | None
    deviation: float


@dataclass(frozen=True)
class TagResult:
    """One tag at the end of the run. `outcome` is read, unreachable, scan_failed, skipped or seen."""

    tag_id: str
    pose: TagPose | None
    outcome: str
    reason: str
    visited: bool
    discovered_s: float | None
    read_s: float | None
    sightings: int
    readings: tuple[Reading, ...]
    health: str
    worst_deviation: float
    flower: FlowerLook | None
    footprint: tuple[Point, ...]


def reason(detail: str) -> str:
    """A mission's detail code in words; text that is no code stays as it is."""
    best = max((code for code in REASONS if detail.startswith(code)), key=len, default="")
    if not best:
        return detail
    rest = detail[len(best) :].lstrip("=: ")
    return f"{REASONS[best]} ({rest})" if rest and not rest.startswith("_") else REASONS[best]


def natural_key(tag_id: str) -> tuple[int, int, str]:
    """Numeric ids first and in order of number, then the others."""
    return (0, int(tag_id), tag_id) if tag_id.isdecimal() else (1, 0, tag_id)


def tag_results(log: RunLog) -> list[TagResult]:
    """Every tag that anything in the run spoke of, in natural order."""
    ids = {*log.discovered, *log.twin, *(seen.tag_id for seen in log.seen if seen.tag_id)}
    return [_result(tag_id, log) for tag_id in sorted(ids, key=natural_key)]


def _result(tag_id: str, log: RunLog) -> TagResult:
    mine = [seen for seen in log.seen if seen.tag_id == tag_id]
    attempts = [seen for seen in mine if seen.kind == "tag_reading"]
    good = [seen for seen in attempts if seen.status == "ok"]
    visits = [seen for seen in attempts if seen.source in _VISITS]
    twin_pose, twin_flower, twin_readings = log.twin.get(tag_id, (None, None, ()))
    discovered = log.discovered.get(tag_id)
    readings = _latest(good, dict(twin_readings))
    grade, worst = health((r.sensor, r.value) for r in readings)
    outcome, why = _outcome(visits or attempts, bool(readings))
    looks = [seen.flower for seen in mine if seen.flower is not None]
    flower = looks[-1] if looks else twin_flower
    poses = [discovered.pose if discovered else None, twin_pose, *(seen.pose for seen in reversed(good))]
    return TagResult(
        tag_id,
        next((pose for pose in poses if pose is not None), None),
        outcome,
        why,
        any(seen.status == "ok" for seen in visits),
        discovered.first_t_s if discovered else None,
        (next((s for s in visits if s.status == "ok"), None) or (good[0] if good else None) or _NEVER).t_s if good else None,
        discovered.sightings if discovered else 0,
        readings,
        grade,
        worst,
        flower,
        log.boxes.get(tag_id) or (flower.footprint if flower else ()),
    )


_NEVER = Seen(0.0, "", "", "", "", "")


def _outcome(attempts: list[Seen], has_readings: bool) -> tuple[str, str]:
    """The outcome that counts: a success anywhere, else the last attempt."""
    if any(seen.status == "ok" for seen in attempts):
        return READ, ""
    if attempts:
        last = attempts[-1]
        names = {"unreachable": UNREACHABLE, "scan_failed": SCAN_FAILED, "skipped": SKIPPED}
        return names.get(last.status, SEEN_ONLY), reason(last.detail)
    return (READ if has_readings else SEEN_ONLY), ""


def _latest(good: Iterable[Seen], twin: Mapping[str, float]) -> tuple[Reading, ...]:
    """The latest value per sensor in order of first appearance; the twin's where the observation is not in the recording."""
    latest: dict[str, Reading] = {}
    for seen in good:
        for sensor, value in seen.readings:
            latest[sensor] = Reading(sensor, value, seen.t_s, deviation(sensor, value))
    for sensor, value in twin.items():
        latest.setdefault(sensor, Reading(sensor, value, None, deviation(sensor, value)))
    return tuple(latest.values())
