"""What a person should know after a run, worst first, each with what it means."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from lupin_runtime.report.health import CRITICAL, SENSORS
from lupin_runtime.report.log import LogLine, RunLog
from lupin_runtime.report.tags import SCAN_FAILED, SKIPPED, UNREACHABLE, TagResult, natural_key
from lupin_runtime.report.timeline import Timeline

ERROR, WARN, NOTE, GOOD = "error", "warn", "note", "good"
_ORDER = (ERROR, WARN, NOTE, GOOD)
_LOG_LINES = 5
_ERROR_LEVEL = 40  # rcl_interfaces/Log
_NOTABLE_CORRECTION_M = 0.05


@dataclass(frozen=True)
class Finding:
    """One thing worth knowing. `severity` is error, warn, note or good."""

    severity: str
    title: str
    detail: str = ""


@dataclass(frozen=True)
class TagTruth:
    """What the simulator knows of a tag: how far the found one was off (None: not compared), whether it can be reached."""

    error_m: float | None
    reachable: bool | None


def findings(
    log: RunLog, tags: list[TagResult], bands: Timeline, facts: Mapping[str, Any], truth: Mapping[str, TagTruth]
) -> list[Finding]:
    """All findings of a run, worst first. `truth` is empty where none is known."""
    found = [
        *_tags(tags, truth if log.mission_id else {}),
        *_plants(tags),
        *_stops(bands),
        *_processes(facts),
        *_collisions(facts.get("collisions")),
        *_map(log),
        *_words(log),
    ]
    return sorted(found, key=lambda finding: _ORDER.index(finding.severity))


def _tags(tags: list[TagResult], truth: Mapping[str, TagTruth]) -> Iterable[Finding]:
    for tag in tags:
        known = truth.get(tag.tag_id)
        if tag.outcome == UNREACHABLE and known is not None and known.reachable is False:
            yield Finding(NOTE, f"Tag {tag.tag_id} can't be reached", "The world has no free way to it.")
        elif tag.outcome == UNREACHABLE:
            yield Finding(WARN, f"Tag {tag.tag_id} was not reached", _sentence(tag.reason))
        elif tag.outcome == SCAN_FAILED:
            yield Finding(WARN, f"Tag {tag.tag_id} was reached but not read", _sentence(tag.reason))
        elif tag.outcome == SKIPPED:
            yield Finding(NOTE, f"Tag {tag.tag_id} was skipped", _sentence(tag.reason))
    seen = {tag.tag_id for tag in tags}
    if missed := [tag_id for tag_id, known in truth.items() if tag_id not in seen and known.reachable is not False]:
        where = ", ".join(sorted(missed, key=natural_key))
        yield Finding(WARN, f"{_count(len(missed), 'tag')} never seen", f"The world also holds tag {where}.")
    if truth and (imagined := sorted(seen - truth.keys(), key=natural_key)):
        yield Finding(WARN, f"{_count(len(imagined), 'tag')} that the world does not hold", f"Tag {', '.join(imagined)}.")
    if tags and not missed and all(tag.outcome == "read" for tag in tags):
        yield Finding(GOOD, "Every tag that was found was read")


def _plants(tags: list[TagResult]) -> Iterable[Finding]:
    if buggy := [tag for tag in tags if tag.flower is not None and tag.flower.anomaly]:
        where = ", ".join(f"{tag.tag_id} ({_count(tag.flower.bug_count, 'bug')})" for tag in buggy if tag.flower)
        yield Finding(WARN, f"Bugs at {_count(len(buggy), 'pot')}", f"Tag {where}.")
    for tag in tags:
        worst = max(tag.readings, key=lambda reading: reading.deviation, default=None)
        if tag.health == CRITICAL and worst is not None:
            ideal = SENSORS[worst.sensor]
            yield Finding(
                WARN,
                f"{ideal.label} at tag {tag.tag_id} is critical",
                f"{worst.value:.4g} {ideal.unit}; well is {ideal.low:g} to {ideal.high:g} {ideal.unit}.",
            )


def _stops(bands: Timeline) -> Iterable[Finding]:
    for label, title in (("e-stop", "E-stop pressed"), ("paused", "Paused"), ("battery low", "Battery low")):
        mine = [band for band in bands.flags if band.label == label]
        if mine:
            total = sum(band.to_s - band.from_s for band in mine)
            times = f"{title} {_count(len(mine), 'time')}" if len(mine) > 1 else title
            yield Finding(WARN if label != "paused" else NOTE, times, f"{total:.0f} s in all.")


def _processes(facts: Mapping[str, Any]) -> Iterable[Finding]:
    for death in facts.get("deaths") or ():
        severity = WARN if death.get("consequence") == "restarted" else ERROR
        yield Finding(
            severity,
            f"{death.get('stage', 'a process')} {death.get('status', 'ended')}",
            _sentence(str(death.get("consequence", ""))),
        )
    factor = facts.get("real_time_factor")
    if isinstance(factor, float) and factor < 0.98:
        yield Finding(
            WARN, f"Slower than real time: {factor:.2f}×", "The computer could not keep up; the simulation waited for it."
        )


def _collisions(count: Any) -> Iterable[Finding]:
    if count:
        yield Finding(ERROR, _count(int(count), "collision").capitalize(), "The robot touched something while it drove.")
    elif count == 0:
        yield Finding(GOOD, "No collision")


def _map(log: RunLog) -> Iterable[Finding]:
    large = [step for step in log.trajectory.corrections if step.distance_m >= _NOTABLE_CORRECTION_M]
    if large:
        worst = max(large, key=lambda step: step.distance_m)
        yield Finding(
            NOTE,
            f"The map corrected the robot's place {_count(len(large), 'time')} by 5 cm or more",
            f"The largest step was {worst.distance_m * 100:.0f} cm at {clock(worst.t_s)}.",
        )
    if log.trajectory.frame != "map" and len(log.trajectory):
        yield Finding(WARN, "There was no map", "The path below is pure odometry.")


def _words(log: RunLog) -> Iterable[Finding]:
    """The warnings and errors of the nodes, the most frequent first; digits are alike, so that repeats count as one."""
    alike: dict[tuple[int, str, str], list[LogLine]] = {}
    for line in log.lines:
        alike.setdefault((line.level, line.node, re.sub(r"\d+", "#", line.text)), []).append(line)
    for lines in sorted(alike.values(), key=lambda lines: (-lines[0].level, -len(lines)))[:_LOG_LINES]:
        first = lines[0]
        kind = "an error" if first.level >= _ERROR_LEVEL else "a warning"
        times = f", {len(lines)} times" if len(lines) > 1 else ""
        yield Finding(NOTE, f"{first.node} logged {kind}{times}", f"{clock(first.t_s)}: {first.text}")


def clock(t_s: float) -> str:
    """Seconds as m:ss, or h:mm:ss."""
    minutes, seconds = divmod(int(t_s), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{seconds:02d}" if hours else f"{minutes}:{seconds:02d}"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}." if text else ""
