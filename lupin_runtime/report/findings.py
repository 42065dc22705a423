"""What the operator should know after a run: problems, notes and successes, worst first."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from lupin_runtime.report.health import CRITICAL, SENSORS
from lupin_runtime.report.run_log import LogLine, RunLog
from lupin_runtime.report.tags import SCAN_FAILED, SKIPPED, UNREACHABLE, TagResult, natural_key
from lupin_runtime.report.timeline import Timeline

ERROR, WARN, NOTE, GOOD = "error", "warn", "note", "good"
_ORDER = (ERROR, WARN, NOTE, GOOD)
_MAX_LOG_FINDINGS = 5
_ERROR_LEVEL = 40  # rcl_interfaces/Log
_NOTABLE_CORRECTION_M = 0.05


@dataclass(frozen=True)
class RunFinding:
    """One result of a run. `severity` is error, warn, note or good."""

    severity: str
    title: str
    detail: str = ""


@dataclass(frozen=True)
class TagTruth:
    """The simulator's truth of a tag: the found tag's position error (None: not compared), and whether it is reachable."""

    error_m: float | None
    reachable: bool | None


def run_findings(
    log: RunLog, tags: list[TagResult], bands: Timeline, facts: Mapping[str, Any], truth: Mapping[str, TagTruth]
) -> list[RunFinding]:
    """Return all findings of a run, worst first. `truth` maps tag ids to the truth; empty if unknown."""
    found = [
        *_tag_findings(tags, truth if log.mission_id else {}),
        *_plant_findings(tags),
        *_hold_findings(bands),
        *_process_findings(facts),
        *_collision_findings(facts.get("collisions")),
        *_map_findings(log),
        *_log_findings(log),
    ]
    return sorted(found, key=lambda finding: _ORDER.index(finding.severity))


def _tag_findings(tags: list[TagResult], truth: Mapping[str, TagTruth]) -> Iterable[RunFinding]:
    for tag in tags:
        tag_truth = truth.get(tag.tag_id)
        if tag.outcome == UNREACHABLE and tag_truth is not None and tag_truth.reachable is False:
            yield RunFinding(NOTE, f"Tag {tag.tag_id} cannot be reached", "The world has no free path to it.")
        elif tag.outcome == UNREACHABLE:
            yield RunFinding(WARN, f"Tag {tag.tag_id} was not reached", _sentence(tag.reason))
        elif tag.outcome == SCAN_FAILED:
            yield RunFinding(WARN, f"Tag {tag.tag_id} was reached but not read", _sentence(tag.reason))
        elif tag.outcome == SKIPPED:
            yield RunFinding(NOTE, f"Tag {tag.tag_id} was skipped", _sentence(tag.reason))
    seen = {tag.tag_id for tag in tags}
    if missed := [tag_id for tag_id, t in truth.items() if tag_id not in seen and t.reachable is not False]:
        where = ", ".join(sorted(missed, key=natural_key))
        yield RunFinding(WARN, f"{_count(len(missed), 'tag')} never seen", f"The world also contains tag {where}.")
    if truth and (false_tags := sorted(seen - truth.keys(), key=natural_key)):
        yield RunFinding(
            WARN, f"{_count(len(false_tags), 'tag')} that the world does not contain", f"Tag {', '.join(false_tags)}."
        )
    if tags and not missed and all(tag.outcome == "read" for tag in tags):
        yield RunFinding(GOOD, "Every tag that was found was read")


def _plant_findings(tags: list[TagResult]) -> Iterable[RunFinding]:
    if infested := [tag for tag in tags if tag.flower is not None and tag.flower.anomaly]:
        where = ", ".join(f"{tag.tag_id} ({_count(tag.flower.bug_count, 'bug')})" for tag in infested if tag.flower)
        yield RunFinding(WARN, f"Bugs at {_count(len(infested), 'pot')}", f"Tag {where}.")
    for tag in tags:
        worst = max(tag.readings, key=lambda reading: reading.deviation, default=None)
        if tag.health == CRITICAL and worst is not None:
            ideal = SENSORS[worst.sensor]
            yield RunFinding(
                WARN,
                f"{ideal.label} at tag {tag.tag_id} is critical",
                f"{worst.value:.4g} {ideal.unit}; ideal is {ideal.low:g} to {ideal.high:g} {ideal.unit}.",
            )


def _hold_findings(bands: Timeline) -> Iterable[RunFinding]:
    for label, title in (("e-stop", "E-stop pressed"), ("paused", "Paused"), ("battery low", "Battery low")):
        matching = [band for band in bands.flags if band.label == label]
        if matching:
            total = sum(band.to_s - band.from_s for band in matching)
            times = f"{title} {_count(len(matching), 'time')}" if len(matching) > 1 else title
            yield RunFinding(WARN if label != "paused" else NOTE, times, f"{total:.0f} s in total.")


def _process_findings(facts: Mapping[str, Any]) -> Iterable[RunFinding]:
    for death in facts.get("deaths") or ():
        severity = WARN if death.get("consequence") == "restarted" else ERROR
        yield RunFinding(
            severity,
            f"{death.get('stage', 'a process')} {death.get('status', 'ended')}",
            _sentence(str(death.get("consequence", ""))),
        )
    factor = facts.get("real_time_factor")
    if isinstance(factor, float) and factor < 0.98:
        yield RunFinding(WARN, f"Slower than real time: {factor:.2f}×", "The computer was too slow for the simulation.")


def _collision_findings(count: Any) -> Iterable[RunFinding]:
    if count:
        yield RunFinding(ERROR, _count(int(count), "collision").capitalize(), "The robot touched an obstacle while driving.")
    elif count == 0:
        yield RunFinding(GOOD, "No collision")


def _map_findings(log: RunLog) -> Iterable[RunFinding]:
    large = [step for step in log.trajectory.corrections if step.distance_m >= _NOTABLE_CORRECTION_M]
    if large:
        worst = max(large, key=lambda step: step.distance_m)
        yield RunFinding(
            NOTE,
            f"The map corrected the robot's position {_count(len(large), 'time')} by 5 cm or more",
            f"The largest step was {worst.distance_m * 100:.0f} cm at {clock(worst.t_s)}.",
        )
    if log.trajectory.frame != "map" and len(log.trajectory):
        yield RunFinding(WARN, "No map was recorded", "The path is from odometry only.")


def _log_findings(log: RunLog) -> Iterable[RunFinding]:
    """Group the nodes' warnings and errors, ignoring digits so that repetitions count as one; worst and most frequent first."""
    groups: dict[tuple[int, str, str], list[LogLine]] = {}
    for line in log.lines:
        groups.setdefault((line.level, line.node, re.sub(r"\d+", "#", line.text)), []).append(line)
    for lines in sorted(groups.values(), key=lambda lines: (-lines[0].level, -len(lines)))[:_MAX_LOG_FINDINGS]:
        first = lines[0]
        kind = "an error" if first.level >= _ERROR_LEVEL else "a warning"
        times = f", {len(lines)} times" if len(lines) > 1 else ""
        yield RunFinding(NOTE, f"{first.node} logged {kind}{times}", f"{clock(first.t_s)}: {first.text}")


def clock(t_s: float) -> str:
    """Format seconds as m:ss, or h:mm:ss."""
    minutes, seconds = divmod(int(t_s), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{seconds:02d}" if hours else f"{minutes}:{seconds:02d}"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}." if text else ""
