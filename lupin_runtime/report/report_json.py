"""The content of `report.json`, a stable format for scripts that `docs/report.md` describes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime, timezone
from typing import Any

import numpy as np

from lupin_runtime.geometry import Pose2
from lupin_runtime.report.findings import RunFinding, TagTruth, run_findings
from lupin_runtime.report.health import SENSORS, health
from lupin_runtime.report.link import Link
from lupin_runtime.report.palette import species_label
from lupin_runtime.report.run_log import RunLog, TimedPosition
from lupin_runtime.report.series import RunSeries, TimeSeries, keep_extremes, run_series
from lupin_runtime.report.tags import READ, UNREACHABLE, TagResult, tag_results
from lupin_runtime.report.timeline import Timeline, build_timeline

SCHEMA = "lupin-report/1"
_PATH_PERIOD_S = 0.5

# Figures of a score that concern the whole run.
SCORE_FIELDS = (
    "tags_total",
    "tags_reachable",
    "tags_found",
    "tags_read",
    "trajectory_rmse_m",
    "tag_error_median_m",
    "flowers_total",
    "flowers_right",
    "bugs_total",
    "bugs_found",
    "bugs_imagined",
)


@dataclass
class ReportInput:
    """Everything that a report is built from.

    `facts` come from the supervisor, `score` from a comparison with the truth, `truth` from the simulator; `damage` names
    problems with the recordings.
    """

    log: RunLog
    facts: dict[str, Any] = field(default_factory=dict)
    score: dict[str, Any] = field(default_factory=dict)
    truth: dict[str, Any] = field(default_factory=dict)
    map_from_world: Pose2 = field(default_factory=Pose2)
    true_path: list[TimedPosition] = field(default_factory=list)
    run_id: str = ""
    recordings: list[str] = field(default_factory=list)
    damage: list[str] = field(default_factory=list)
    metadata: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.tags: list[TagResult] = tag_results(self.log)
        self.timeline: Timeline = build_timeline(self.log)
        self.tag_truth: dict[str, TagTruth] = _tag_truth(self.tags, self.truth, self.score, self.map_from_world)
        self.series: RunSeries = run_series(self.log, self.true_path)
        facts = {**self.facts, **{name: self.fact(name) for name in ("collisions", "real_time_factor")}}
        self.findings: list[RunFinding] = run_findings(
            self.log, self.tags, self.timeline, self.series, facts, self.tag_truth, self.run_id if self.facts else ""
        )
        self.findings += [RunFinding("warn", "This report is incomplete", text) for text in self.damage]

    @property
    def state(self) -> str:
        """How the run ended: the supervisor's state, else the mission's last state."""
        recorded = self.log.mission[-1].state if self.log.mission else ""
        return str(self.facts.get("state") or recorded or "UNKNOWN")

    @property
    def mission_span_s(self) -> tuple[float, float]:
        """Start and end of the mission, in seconds of the recording."""
        active = [b for b in self.timeline.states if b.label not in ("BOOT", "READY", "DONE", "FAULT")]
        return (active[0].from_s, active[-1].to_s) if active else (0.0, self.log.end_s)

    def fact(self, name: str) -> Any:
        """Return a fact of the run, its score or its options; None if unknown."""
        for group in (self.facts, self.score, self.facts.get("options") or {}):
            if group.get(name) is not None:
                return group[name]
        return None


def figures(report: ReportInput) -> dict[str, Any]:
    """Return the run's figures; None for unknown ones."""
    log, tags, score = report.log, report.tags, report.score
    begin_s, end_s = report.mission_span_s
    pots = [tag.flower for tag in tags if tag.flower is not None]
    return {
        "mission_s": _round(end_s - begin_s, 1),
        "recorded_s": _round(log.end_s, 1),
        "sim_time_s": _number(report.fact("sim_time_s")),
        "wall_time_s": _number(report.fact("wall_time_s")),
        "real_time_factor": _number(report.fact("real_time_factor")),
        "memory_mb": _number(report.fact("memory_mb")),
        "collisions": _number(report.fact("collisions")),
        "drivable_s": _number(report.fact("drivable_s")),
        "ready_s": _number(report.fact("ready_s")),
        "distance_m": _round(log.trajectory.length_m, 2),
        "known_area_m2": _round(log.known_area[-1][1], 1) if log.known_area else None,
        "tags_seen": len(tags),
        "tags_read": sum(tag.outcome == READ for tag in tags),
        "tags_visited": sum(tag.visited for tag in tags),
        "tags_unreachable": sum(tag.outcome == UNREACHABLE for tag in tags),
        "flowers": sum(pot.flower_count or len(pot.placed) for pot in pots),
        "bugs": sum(pot.bug_count for pot in pots),
        "health": health((r.sensor, r.value) for tag in tags for r in tag.readings)[0],
        "map_corrections": len(log.trajectory.corrections),
        "largest_localization_error_m": _round(_value(report.series.localization_error_m.high), 3),
        "least_clearance_m": _round(_value(report.series.clearance_m.low), 3),
        "outages": len(log.link.outages),
        "longest_outage_s": _round(log.link.longest_s, 1),
        "largest_correction_m": _round(max((c.distance_m for c in log.trajectory.corrections), default=0.0), 3),
        **{f"score_{name}": _figure(score.get(name)) for name in SCORE_FIELDS},
    }


def report_content(report: ReportInput) -> dict[str, Any]:
    """Return the content of `report.json`."""
    log = report.log
    return {
        "schema": SCHEMA,
        "run": run_content(report),
        "figures": figures(report),
        "findings": [finding_content(finding) for finding in report.findings],
        "tags": [_tag(tag, report) for tag in report.tags],
        "timeline": _timeline(report.timeline),
        "path": _path(report),
        "map": _map(log),
        "fields": _fields(report.tags),
        "series": {name: _series(getattr(report.series, name)) for name in RunSeries.__dataclass_fields__},
        "link": _link(log.link),
        "battery": [[_round(t, 1), _round(v, 3)] for t, v in log.battery],
        "score": report.score or None,
        "facts": report.facts,
    }


def run_content(report: ReportInput) -> dict[str, Any]:
    """Return what the run was: its id, outcome, place, mission, time and recordings."""
    return {
        "id": report.run_id,
        "state": report.state,
        "exit_status": report.facts.get("exit_status"),
        "sentence": report.facts.get("sentence", ""),
        "target": report.fact("target"),
        "world": report.fact("world"),
        "mission_id": report.log.mission_id,
        "mission_type": report.log.mission_type,
        "started_at": report.metadata.get("started_at"),
        "built_at": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "recordings": report.recordings,
        "recording_start_ns": report.log.start_ns,
    }


def _tag_truth(
    tags: list[TagResult], truth: Mapping[str, Any], score: Mapping[str, Any], map_from_world: Pose2
) -> dict[str, TagTruth]:
    """Return the true tags by id. A tag's error is the score's, else the distance to its true position."""
    scored = {str(tag_id): _number(error) for tag_id, error in (score.get("tag_errors_m") or {}).items()}
    placed = {tag.tag_id: tag.pose for tag in tags if tag.pose is not None}
    found = {}
    for item in truth.get("tags") or ():
        tag_id = str(item["id"])
        error, pose = scored.get(tag_id), placed.get(tag_id)
        if error is None and pose is not None:
            x, y = map_from_world.apply(float(item["x"]), float(item["y"]))
            error = math.hypot(pose.x - x, pose.y - y)
        reachable = item.get("reachable")
        found[tag_id] = TagTruth(error, None if reachable is None else bool(reachable))
    return found


def finding_content(finding: RunFinding) -> dict[str, Any]:
    """Return a finding for scripts."""
    return {
        "severity": finding.severity,
        "title": finding.title,
        "detail": finding.detail,
        "action": finding.action,
        "command": finding.command,
        "t_s": _round(finding.t_s, 1),
        "tag_ids": list(finding.tag_ids),
    }


def _tag(tag: TagResult, report: ReportInput) -> dict[str, Any]:
    pose, pot = tag.pose, tag.flower
    return {
        "id": tag.tag_id,
        "outcome": tag.outcome,
        "reason": tag.reason,
        "visited": tag.visited,
        "x": _round(pose.x, 3) if pose else None,
        "y": _round(pose.y, 3) if pose else None,
        "z": _round(pose.z, 3) if pose else None,
        "facing_rad": _round(pose.facing_rad, 4) if pose and pose.facing_rad is not None else None,
        "discovered_s": _round(tag.discovered_s, 1),
        "read_s": _round(tag.read_s, 1),
        "sightings": tag.sightings,
        "error_m": _round(report.tag_truth[tag.tag_id].error_m, 4) if tag.tag_id in report.tag_truth else None,
        "health": tag.health,
        "readings": [
            {
                "sensor": reading.sensor,
                "value": _number(reading.value),
                "unit": SENSORS[reading.sensor].unit if reading.sensor in SENSORS else "",
                "at_s": _round(reading.t_s, 1),
                "deviation": _round(reading.deviation, 3),
            }
            for reading in tag.readings
        ],
        "flowers": None
        if pot is None
        else {
            "species": pot.species,
            "label": species_label(pot.species),
            "confidence": _round(pot.confidence, 3),
            "anomaly": pot.anomaly,
            "flower_count": pot.flower_count,
            "bug_count": pot.bug_count,
            "blooms": [
                {"x": _round(b.x, 3), "y": _round(b.y, 3), "species": b.species, "anomaly": b.anomaly} for b in pot.placed
            ],
        },
        "box_footprint": [[_round(x, 3), _round(y, 3)] for x, y in tag.footprint],
    }


def _timeline(bands: Timeline) -> dict[str, Any]:
    rows = {"states": bands.states, "legs": bands.legs, "flags": bands.flags, "outages": bands.outages}
    return {
        name: [{"from_s": _round(b.from_s, 1), "to_s": _round(b.to_s, 1), "label": b.label, "detail": b.detail} for b in row]
        for name, row in rows.items()
    } | {
        "events": [
            {"t_s": _round(e.t_s, 1), "kind": e.kind, "severity": e.severity, "text": e.text, "tag_id": e.tag_id}
            for e in bands.events
        ]
    }


def _link(link: Link) -> dict[str, Any]:
    return {
        "outages": [
            {"from_s": _round(o.from_s, 1), "to_s": _round(o.to_s, 1), "moved_m": _round(o.moved_m, 3)} for o in link.outages
        ],
        "lost_share": _round(link.lost_share, 4),
        "late_s": _round(link.late_s, 3),
    }


def _path(report: ReportInput) -> dict[str, Any]:
    path = report.log.trajectory
    keep = thin(path.t_s, _PATH_PERIOD_S)
    return {
        "frame": path.frame,
        "t_s": [_round(v, 1) for v in path.t_s[keep]],
        "x": [_round(v, 3) for v in path.x[keep]],
        "y": [_round(v, 3) for v in path.y[keep]],
        "yaw": [_round(v, 3) for v in path.yaw[keep]],
        "corrections": [
            {"t_s": _round(c.t_s, 1), "distance_m": _round(c.distance_m, 3), "turn_rad": _round(c.turn_rad, 4)}
            for c in path.corrections
        ],
    }


def thin(t_s: Any, period_s: float) -> list[int]:
    """Return indices of times at least `period_s` apart, and the last index."""
    kept: list[int] = []
    for index, t in enumerate(np.asarray(t_s)):
        if not kept or t - t_s[kept[-1]] >= period_s - 1e-6:
            kept.append(index)
    if kept and kept[-1] != len(t_s) - 1:
        kept.append(len(t_s) - 1)
    return kept


def _series(series: TimeSeries) -> dict[str, Any]:
    points = [[_round(t, 1), _round(value, 3)] for t, value in keep_extremes(series.points)]
    return {"points": points or None, "missing": series.missing or None}


def _map(log: RunLog) -> dict[str, Any] | None:
    if log.map is None:
        return None
    return {
        "width": log.map.width,
        "height": log.map.height,
        "resolution_m": _round(log.map.resolution_m, 4),
        "origin_x": _round(log.map.origin_x, 3),
        "origin_y": _round(log.map.origin_y, 3),
        "known_area_m2": [[_round(t, 1), _round(area, 1)] for t, area in log.known_area],
    }


def _fields(tags: list[TagResult]) -> dict[str, Any]:
    fields = {}
    for sensor, ideal in SENSORS.items():
        values = [r.value for tag in tags for r in tag.readings if r.sensor == sensor and math.isfinite(r.value)]
        if values:
            fields[sensor] = {
                "unit": ideal.unit,
                "samples": len(values),
                "min": min(values),
                "max": max(values),
                "mean": sum(values) / len(values),
                "ideal_min": ideal.low,
                "ideal_max": ideal.high,
            }
    return fields


def _value(point: tuple[float, float] | None) -> float | None:
    return None if point is None else point[1]


def _round(value: Any, digits: int) -> float | None:
    number = _number(value)
    return None if number is None else round(number, digits)


def _number(value: Any) -> float | None:
    """Return a finite float, else None: JSON has no NaN."""
    if value is None:
        return None
    try:
        number = float(value)
    except (TypeError, ValueError):
        return None
    return number if math.isfinite(number) else None


def _figure(value: Any) -> int | float | None:
    """Return an integer unchanged, another number as a finite float, else None."""
    return value if isinstance(value, int) else _number(value)


def to_plain(value: Any) -> Any:
    """Convert a value for JSON: other types become strings, numbers that are not finite become None."""
    if isinstance(value, Mapping):
        return {str(key): to_plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [to_plain(item) for item in value]
    if isinstance(value, (bool, str, type(None))):
        return value
    if isinstance(value, int):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return _number(value)
    if isinstance(value, np.integer):
        return int(value)
    return str(value)
