"""The result of each tag at the end of a run, from perception, the mission's observations and the twin."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from lupin_runtime.mission.events import explain
from lupin_runtime.report.health import deviation, health
from lupin_runtime.report.run_log import LoggedPot, ObservationEntry, Point, RunLog, TagPlacement, TwinTag

READ, UNREACHABLE, SCAN_FAILED, SKIPPED, SEEN_ONLY = "read", "unreachable", "scan_failed", "skipped", "seen"

# Explorations also read tags over the bridge when they are discovered; those observations are no visits.
_VISIT_SOURCES = ("InspectionMission", "MonitoringMission")


@dataclass(frozen=True)
class LatestReading:
    """The latest value of a sensor."""

    sensor: str
    value: float
    t_s: float | None
    deviation: float


@dataclass(frozen=True)
class TagResult:
    """One tag at the end of the run. `outcome` is read, unreachable, scan_failed, skipped or seen."""

    tag_id: str
    pose: TagPlacement | None
    outcome: str
    reason: str
    visited: bool
    discovered_s: float | None
    read_s: float | None
    attempted_s: float | None
    sightings: int
    readings: tuple[LatestReading, ...]
    health: str
    worst_deviation: float
    flower: LoggedPot | None
    footprint: tuple[Point, ...]


def natural_key(tag_id: str) -> tuple[int, int, str]:
    """Return a sort key: numeric ids in numeric order, then the others."""
    return (0, int(tag_id), tag_id) if tag_id.isdecimal() else (1, 0, tag_id)


def tag_results(log: RunLog) -> list[TagResult]:
    """Return the result of every tag in the recording, sorted by `natural_key`."""
    ids = {*log.discovered, *log.twin, *(entry.tag_id for entry in log.observations if entry.tag_id)}
    return [_result(tag_id, log) for tag_id in sorted(ids, key=natural_key)]


def _result(tag_id: str, log: RunLog) -> TagResult:
    entries = [entry for entry in log.observations if entry.tag_id == tag_id]
    attempts = [entry for entry in entries if entry.kind == "tag_reading"]
    successes = [entry for entry in attempts if entry.status == "ok"]
    visits = [entry for entry in attempts if entry.source in _VISIT_SOURCES]
    twin = log.twin.get(tag_id, TwinTag())
    discovered = log.discovered.get(tag_id)
    readings = _latest(successes, dict(twin.readings))
    grade, worst = health((r.sensor, r.value) for r in readings)
    outcome, why = _outcome(visits or attempts, bool(readings))
    pots = [entry.flower for entry in entries if entry.flower is not None]
    flower = pots[-1] if pots else twin.flower
    poses = [discovered.pose if discovered else None, twin.pose, *(entry.pose for entry in reversed(successes))]
    return TagResult(
        tag_id,
        next((pose for pose in poses if pose is not None), None),
        outcome,
        why,
        any(entry.status == "ok" for entry in visits),
        discovered.first_t_s if discovered else None,
        next((entry.t_s for entry in (*visits, *successes) if entry.status == "ok"), None),
        (visits or attempts)[-1].t_s if attempts else None,
        discovered.sightings if discovered else 0,
        readings,
        grade,
        worst,
        flower,
        log.boxes.get(tag_id) or (flower.footprint if flower else ()),
    )


def _outcome(attempts: list[ObservationEntry], has_readings: bool) -> tuple[str, str]:
    """Return (outcome, reason): a success at any time, else the last attempt."""
    if any(entry.status == "ok" for entry in attempts):
        return READ, ""
    if attempts:
        last = attempts[-1]
        names = {"unreachable": UNREACHABLE, "scan_failed": SCAN_FAILED, "skipped": SKIPPED}
        return names.get(last.status, SEEN_ONLY), explain(last.detail)
    return (READ if has_readings else SEEN_ONLY), ""


def _latest(successes: Iterable[ObservationEntry], twin: Mapping[str, float]) -> tuple[LatestReading, ...]:
    """Return the latest value per sensor in order of first appearance; the twin's value if the recording has no reading."""
    latest: dict[str, LatestReading] = {}
    for entry in successes:
        for sensor, value in entry.readings:
            latest[sensor] = LatestReading(sensor, value, entry.t_s, deviation(sensor, value))
    for sensor, value in twin.items():
        latest.setdefault(sensor, LatestReading(sensor, value, None, deviation(sensor, value)))
    return tuple(latest.values())
