"""`report.json`: what a run was, in one object that scripts may rely on (`docs/report.md` describes it)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime, timezone
from typing import Any

import numpy as np

from lupin_runtime.geometry import Pose2
from lupin_runtime.report.findings import Finding, TagTruth, findings
from lupin_runtime.report.health import SENSORS, health
from lupin_runtime.report.log import RunLog
from lupin_runtime.report.palette import species_label
from lupin_runtime.report.tags import READ, UNREACHABLE, TagResult, tag_results
from lupin_runtime.report.timeline import Timeline, timeline

SCHEMA = "lupin-report/1"
_PATH_PERIOD_S = 0.5

# What a score says of the whole run.
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
class Material:
    """Everything that a report is made of."""

    log: RunLog
    facts: dict[str, Any] = field(default_factory=dict)
    score: dict[str, Any] = field(default_factory=dict)
    truth: dict[str, Any] = field(default_factory=dict)
    map_from_world: Pose2 = field(default_factory=Pose2)
    true_path: list[tuple[float, float]] = field(default_factory=list)
    run_id: str = ""
    recordings: list[str] = field(default_factory=list)
    damage: list[str] = field(default_factory=list)
    metadata: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.tags: list[TagResult] = tag_results(self.log)
        self.timeline: Timeline = timeline(self.log)
        self.tag_truth: dict[str, TagTruth] = _tag_truth(self.tags, self.truth, self.score, self.map_from_world)
        facts = {**self.facts, **{name: self.fact(name) for name in ("collisions", "real_time_factor")}}
        self.findings: list[Finding] = findings(self.log, self.tags, self.timeline, facts, self.tag_truth)
        self.findings += [Finding("warn", "This report is incomplete", text) for text in self.damage]

    @property
    def state(self) -> str:
        """How the run ended: the supervisor's word, else the mission's last state."""
        recorded = self.log.mission[-1].state if self.log.mission else ""
        return str(self.facts.get("state") or recorded or "UNKNOWN")

    @property
    def mission_span_s(self) -> tuple[float, float]:
        """From the first moment of a mission to its end, in seconds of the recording."""
        active = [b for b in self.timeline.states if b.label not in ("BOOT", "READY", "DONE", "FAULT")]
        return (active[0].from_s, active[-1].to_s) if active else (0.0, self.log.end_s)

    def fact(self, name: str) -> Any:
        """A fact of the run, of its score or of its options; None where nobody knows."""
        for group in (self.facts, self.score, self.facts.get("options") or {}):
            if group.get(name) is not None:
                return group[name]
        return None


def figures(material: Material) -> dict[str, Any]:
    """The run in numbers; null where a number is not known."""
    log, tags, score = material.log, material.tags, material.score
    begin_s, end_s = material.mission_span_s
    flowers = [tag.flower for tag in tags if tag.flower is not None]
    return {
        "mission_s": _round(end_s - begin_s, 1),
        "recorded_s": _round(log.end_s, 1),
        "sim_time_s": _number(material.fact("sim_time_s")),
        "wall_time_s": _number(material.fact("wall_time_s")),
        "real_time_factor": _number(material.fact("real_time_factor")),
        "memory_mb": _number(material.fact("memory_mb")),
        "collisions": _number(material.fact("collisions")),
        "drivable_s": _number(material.fact("drivable_s")),
        "ready_s": _number(material.fact("ready_s")),
        "distance_m": _round(log.trajectory.length_m, 2),
        "known_area_m2": _round(log.known_area[-1][1], 1) if log.known_area else None,
        "tags_seen": len(tags),
        "tags_read": sum(tag.outcome == READ for tag in tags),
        "tags_visited": sum(tag.visited for tag in tags),
        "tags_unreachable": sum(tag.outcome == UNREACHABLE for tag in tags),
        "flowers": sum(look.flower_count or len(look.blooms) for look in flowers),
        "bugs": sum(look.bug_count for look in flowers),
        "health": health((r.sensor, r.value) for tag in tags for r in tag.readings)[0],
        "map_corrections": len(log.trajectory.corrections),
        "largest_correction_m": _round(max((c.distance_m for c in log.trajectory.corrections), default=0.0), 3),
        **{f"score_{name}": _figure(score.get(name)) for name in SCORE_FIELDS},
    }


def content(material: Material) -> dict[str, Any]:
    """The whole of `report.json`."""
    log = material.log
    return {
        "schema": SCHEMA,
        "run": {
            "id": material.run_id,
            "state": material.state,
            "exit_status": material.facts.get("exit_status"),
            "sentence": material.facts.get("sentence", ""),
            "target": material.fact("target"),
            "world": material.fact("world"),
            "mission_id": log.mission_id,
            "mission_type": log.mission_type,
            "started_at": material.metadata.get("started_at"),
            "built_at": datetime.now(timezone.utc).isoformat(timespec="seconds"),
            "recordings": material.recordings,
            "recording_start_ns": log.start_ns,
        },
        "figures": figures(material),
        "findings": [{"severity": f.severity, "title": f.title, "detail": f.detail} for f in material.findings],
        "tags": [_tag(tag, material) for tag in material.tags],
        "timeline": _timeline(material.timeline),
        "path": _path(material),
        "map": _map(log),
        "fields": _fields(material.tags),
        "battery": [[_round(t, 1), _round(v, 3)] for t, v in log.battery],
        "score": material.score or None,
        "facts": material.facts,
    }


def _tag_truth(
    tags: list[TagResult], truth: Mapping[str, Any], score: Mapping[str, Any], map_from_world: Pose2
) -> dict[str, TagTruth]:
    """The true tags by id. An error is the score's, else the distance from the true place."""
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


def _tag(tag: TagResult, material: Material) -> dict[str, Any]:
    pose, look = tag.pose, tag.flower
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
        "error_m": _round(material.tag_truth[tag.tag_id].error_m, 4) if tag.tag_id in material.tag_truth else None,
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
        if look is None
        else {
            "species": look.species,
            "label": species_label(look.species),
            "confidence": _round(look.confidence, 3),
            "anomaly": look.anomaly,
            "flower_count": look.flower_count,
            "bug_count": look.bug_count,
            "blooms": [
                {"x": _round(b.x, 3), "y": _round(b.y, 3), "species": b.species, "anomaly": b.anomaly} for b in look.blooms
            ],
        },
        "box_footprint": [[_round(x, 3), _round(y, 3)] for x, y in tag.footprint],
    }


def _timeline(bands: Timeline) -> dict[str, Any]:
    rows = {"states": bands.states, "legs": bands.legs, "flags": bands.flags}
    return {
        name: [{"from_s": _round(b.from_s, 1), "to_s": _round(b.to_s, 1), "label": b.label, "detail": b.detail} for b in row]
        for name, row in rows.items()
    } | {
        "events": [
            {"t_s": _round(e.t_s, 1), "kind": e.kind, "severity": e.severity, "text": e.text, "tag_id": e.tag_id}
            for e in bands.events
        ]
    }


def _path(material: Material) -> dict[str, Any]:
    path = material.log.trajectory
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
    """Indices that are at least `period_s` apart, with the last one."""
    kept: list[int] = []
    for index, t in enumerate(np.asarray(t_s)):
        if not kept or t - t_s[kept[-1]] >= period_s - 1e-6:
            kept.append(index)
    if kept and kept[-1] != len(t_s) - 1:
        kept.append(len(t_s) - 1)
    return kept


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


def _round(value: Any, digits: int) -> float | None:
    number = _number(value)
    return None if number is None else round(number, digits)


def _number(value: Any) -> float | None:
    """A finite float, else None: JSON knows no NaN."""
    if value is None:
        return None
    try:
        number = float(value)
    except (TypeError, ValueError):
        return None
    return number if math.isfinite(number) else None


def _figure(value: Any) -> int | float | None:
    """A count as a whole number, a measure as a finite float, else None."""
    return value if isinstance(value, int) else _number(value)


def plain(value: Any) -> Any:
    """`value` with everything that JSON lacks made into text or null, all the way down."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [plain(item) for item in value]
    if isinstance(value, (bool, str, type(None))):
        return value
    if isinstance(value, int):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return _number(value)
    if isinstance(value, np.integer):
        return int(value)
    return str(value)
