"""What the operator should know after a run: problems, notes and successes, worst first."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from shlex import quote
from typing import Any

from lupin_runtime.report.health import CRITICAL, SENSORS
from lupin_runtime.report.link import Link
from lupin_runtime.report.run_log import LogLine, RunLog
from lupin_runtime.report.series import RunSeries
from lupin_runtime.report.tags import SCAN_FAILED, SKIPPED, UNREACHABLE, TagResult, natural_key
from lupin_runtime.report.timeline import Timeline

ERROR, WARN, NOTE, GOOD = "error", "warn", "note", "good"
SEVERITIES = (ERROR, WARN, NOTE, GOOD)  # the worst first
_MAX_LOG_FINDINGS = 5
_ERROR_LEVEL = 40  # rcl_interfaces/Log
_NOTABLE_CORRECTION_M = 0.05
_NOTABLE_ERROR_M = 0.10
_NARROW_M = 0.05
_MIN_REAL_TIME_FACTOR = 0.98
_NOTABLE_LOSS = 0.01
_MAX_OUTAGES = 5

# What to do about a sensor's value that is too low, or too high.
_REMEDIES = {
    "temperature": ("Heat the greenhouse or close its vents", "Ventilate or shade the greenhouse"),
    "humidity": ("Mist the plants or close the vents", "Ventilate the greenhouse"),
    "co2": ("Dose CO₂ or close the vents", "Ventilate the greenhouse"),
    "light": ("Switch on lamps, or move the plant into the light", "Shade the plant"),
    "soil_moisture": ("Water the plant", "Stop watering the plant, and check its drain"),
}


@dataclass(frozen=True)
class RunFinding:
    """One result of a run. `severity` is error, warn, note or good.

    `action` says what to do about it, `command` what to type for that, `t_s` when it happened, and `tag_ids` which tags it
    concerns; each may be empty.
    """

    severity: str
    title: str
    detail: str = ""
    action: str = ""
    command: str = ""
    t_s: float | None = None
    tag_ids: tuple[str, ...] = ()


@dataclass(frozen=True)
class TagTruth:
    """The simulator's truth of a tag: the found tag's position error (None: not compared), and whether it is reachable."""

    error_m: float | None
    reachable: bool | None


def run_findings(
    log: RunLog,
    tags: list[TagResult],
    bands: Timeline,
    series: RunSeries,
    facts: Mapping[str, Any],
    truth: Mapping[str, TagTruth],
    run_id: str = "",
) -> list[RunFinding]:
    """Return all findings of a run, worst first.

    `truth` maps tag ids to the truth; empty if unknown. `run_id` is empty if the recording is not of a run whose logs can be
    read on this machine.
    """
    found = [
        *_tag_findings(tags, truth if log.mission_id else {}),
        *_plant_findings(tags),
        *_hold_findings(bands, run_id),
        *_process_findings(facts, series, run_id),
        *_collision_findings(facts.get("collisions"), series),
        *_map_findings(log),
        *_localization_findings(series),
        *_link_findings(log.link),
        *_log_findings(log, run_id),
    ]
    return sorted(found, key=lambda finding: SEVERITIES.index(finding.severity))


def _tag_findings(tags: list[TagResult], truth: Mapping[str, TagTruth]) -> Iterable[RunFinding]:
    for tag in tags:
        tag_truth = truth.get(tag.tag_id)
        if tag.outcome == UNREACHABLE and tag_truth is not None and tag_truth.reachable is False:
            yield _tag_finding(NOTE, tag, "cannot be reached", detail="The world has no free path to it.")
        elif tag.outcome == UNREACHABLE:
            action = "Clear the path to it, or draw its approach on the console's map, then visit it alone"
            yield _tag_finding(WARN, tag, "was not reached", action, f"lupin mission start {quote(tag.tag_id)}")
        elif tag.outcome == SCAN_FAILED:
            action = "Check that the tag is clean and lit, then visit it alone"
            yield _tag_finding(WARN, tag, "was reached but not read", action, f"lupin mission start {quote(tag.tag_id)}")
        elif tag.outcome == SKIPPED:
            yield _tag_finding(NOTE, tag, "was skipped", "Visit it alone", f"lupin mission start {quote(tag.tag_id)}")
    seen = {tag.tag_id for tag in tags}
    if missed := [tag_id for tag_id, t in truth.items() if tag_id not in seen and t.reachable is not False]:
        where = ", ".join(sorted(missed, key=natural_key))
        title = f"{_count(len(missed), 'tag')} never seen"
        action = "Select the layer Truth on the map, and see whether the robot came near and faced it"
        yield RunFinding(WARN, title, f"The world also contains tag {where}.", action)
    if truth and (false_tags := sorted(seen - truth.keys(), key=natural_key)):
        title = f"{_count(len(false_tags), 'tag')} that the world does not contain"
        action = "Check that the run's world and the tags' dictionary are the right ones"
        yield RunFinding(WARN, title, f"Tag {', '.join(false_tags)}.", action, tag_ids=tuple(false_tags))
    if tags and not missed and all(tag.outcome == "read" for tag in tags):
        yield RunFinding(GOOD, "Every tag that was found was read")


def _plant_findings(tags: list[TagResult]) -> Iterable[RunFinding]:
    if infested := [tag for tag in tags if tag.flower is not None and tag.flower.anomaly]:
        where = ", ".join(f"{tag.tag_id} ({_count(tag.flower.bug_count, 'bug')})" for tag in infested if tag.flower)
        ids = tuple(tag.tag_id for tag in infested)
        yield RunFinding(WARN, f"Bugs at {_count(len(infested), 'pot')}", f"Tag {where}.", "Treat these plants", tag_ids=ids)
    for tag in tags:
        worst = max(tag.readings, key=lambda reading: reading.deviation, default=None)
        if tag.health == CRITICAL and worst is not None:
            ideal = SENSORS[worst.sensor]
            yield RunFinding(
                WARN,
                f"{ideal.label} at tag {tag.tag_id} is critical",
                f"{worst.value:.4g} {ideal.unit}; ideal is {ideal.low:g} to {ideal.high:g} {ideal.unit}.",
                _REMEDIES[worst.sensor][worst.value > ideal.high] if worst.sensor in _REMEDIES else "",
                t_s=worst.t_s,
                tag_ids=(tag.tag_id,),
            )


def _tag_finding(severity: str, tag: TagResult, what: str, action: str = "", command: str = "", detail: str = "") -> RunFinding:
    detail = detail or _sentence(tag.reason)
    return RunFinding(severity, f"Tag {tag.tag_id} {what}", detail, action, command, tag.attempted_s, (tag.tag_id,))


def _logs_command(run_id: str, process: str = "") -> str:
    """Return the command that prints the logs; "" if there are none on this machine."""
    return " ".join(filter(None, ("lupin logs", process and quote(process), f"--run {quote(run_id)}"))) if run_id else ""


def _hold_findings(bands: Timeline, run_id: str) -> Iterable[RunFinding]:
    for label, title, action, command in (
        ("e-stop", "E-stop pressed", "See in its log what engaged it", _logs_command(run_id, "estop")),
        ("paused", "Paused", "", ""),
        ("battery low", "Battery low", "Charge the battery before the next run", ""),
    ):
        matching = [band for band in bands.flags if band.label == label]
        if matching:
            total = sum(band.to_s - band.from_s for band in matching)
            times = f"{title} {_count(len(matching), 'time')}" if len(matching) > 1 else title
            severity = WARN if label != "paused" else NOTE
            yield RunFinding(severity, times, f"{total:.0f} s in total.", action, command, matching[0].from_s)


def _process_findings(facts: Mapping[str, Any], series: RunSeries, run_id: str) -> Iterable[RunFinding]:
    for death in facts.get("deaths") or ():
        severity = WARN if death.get("consequence") == "restarted" else ERROR
        stage = death.get("stage", "")
        yield RunFinding(
            severity,
            f"{stage or 'a process'} {death.get('status', 'ended')}",
            _sentence(str(death.get("consequence", ""))),
            "Read the last lines of its log" if stage else "",
            _logs_command(run_id, stage) if stage else "",
        )
    factor, lowest = facts.get("real_time_factor"), series.real_time_factor.low
    if isinstance(factor, float) and factor < _MIN_REAL_TIME_FACTOR:
        detail = "The computer was too slow for the simulation"
        detail += f"; its slowest 5 s were at {clock(lowest[0])}, with {lowest[1]:.2f}×." if lowest else "."
        action, command = "Close other programs, or do without flowers and windows", "lupin up --headless --no-yolo"
        t_s = lowest[0] if lowest else None
        yield RunFinding(WARN, f"Slower than real time: {factor:.2f}×", detail, action, command, t_s)


def _collision_findings(count: Any, series: RunSeries) -> Iterable[RunFinding]:
    nearest = series.clearance_m.low
    t_s = nearest[0] if nearest else None
    action = "See on the map what it came near to, then move that or widen the passage"
    if count:
        title, detail = _count(int(count), "collision").capitalize(), "The robot touched an obstacle while driving."
        yield RunFinding(ERROR, title, detail, action, t_s=t_s)
    elif count == 0:
        yield RunFinding(GOOD, "No collision")
    if not count and nearest and nearest[1] < _NARROW_M:
        detail = f"It was nearest to an obstacle at {clock(nearest[0])}."
        yield RunFinding(WARN, f"The robot's clearance was only {nearest[1] * 100:.0f} cm", detail, action, t_s=t_s)


def _map_findings(log: RunLog) -> Iterable[RunFinding]:
    large = [step for step in log.trajectory.corrections if step.distance_m >= _NOTABLE_CORRECTION_M]
    if large:
        worst = max(large, key=lambda step: step.distance_m)
        yield RunFinding(
            NOTE,
            f"The map corrected the robot's position {_count(len(large), 'time')} by 5 cm or more",
            f"The largest step was {worst.distance_m * 100:.0f} cm at {clock(worst.t_s)}.",
            t_s=worst.t_s,
        )
    if log.trajectory.frame != "map" and len(log.trajectory):
        detail, action = "The path is from odometry only.", "Build a map while driving"
        yield RunFinding(WARN, "No map was recorded", detail, action, "lupin up --slam")


def _localization_findings(series: RunSeries) -> Iterable[RunFinding]:
    worst = series.localization_error_m.high
    if worst is not None and worst[1] >= _NOTABLE_ERROR_M:
        yield RunFinding(
            WARN,
            f"The estimated position was up to {worst[1] * 100:.0f} cm wrong",
            f"The error was largest at {clock(worst[0])}.",
            "Select the layer Truth on the map, and see what the lidar could measure there",
            t_s=worst[0],
        )


def _link_findings(link: Link) -> Iterable[RunFinding]:
    action, command = "See how good the link is now, and which one to take", "lupin transport"
    if link.outages:
        times = ", ".join(f"{each.to_s - each.from_s:.1f} s at {clock(each.from_s)}" for each in link.outages[:_MAX_OUTAGES])
        more = f" and {len(link.outages) - _MAX_OUTAGES} more" if len(link.outages) > _MAX_OUTAGES else ""
        moved = [each.moved_m for each in link.outages if each.moved_m is not None]
        detail = f"Nothing arrived from the robot for {times}{more}."
        if moved:
            detail += f" It moved at most {max(moved) * 100:.0f} cm meanwhile."
        title = f"The link to the robot failed {_count(len(link.outages), 'time')}"
        yield RunFinding(WARN, title, detail, action, command, link.outages[0].from_s)
    if (link.lost_share or 0.0) >= _NOTABLE_LOSS:
        detail = f"All but 1 % arrived within {1e3 * (link.late_s or 0.0):.0f} ms of the fastest."
        yield RunFinding(NOTE, f"The link lost {100 * (link.lost_share or 0.0):.1f} % of the scans", detail, action, command)


def _log_findings(log: RunLog, run_id: str) -> Iterable[RunFinding]:
    """Group the nodes' warnings and errors, ignoring digits so that repetitions count as one; worst and most frequent first."""
    groups: dict[tuple[int, str, str], list[LogLine]] = {}
    for line in log.lines:
        groups.setdefault((line.level, line.node, re.sub(r"\d+", "#", line.text)), []).append(line)
    for lines in sorted(groups.values(), key=lambda lines: (-lines[0].level, -len(lines)))[:_MAX_LOG_FINDINGS]:
        first = lines[0]
        kind = "an error" if first.level >= _ERROR_LEVEL else "a warning"
        times = f", {len(lines)} times" if len(lines) > 1 else ""
        command = f"{_logs_command(run_id)} --level warn" if run_id else ""
        action = "Read the lines around it" if command else ""
        detail = f"{clock(first.t_s)}: {first.text}"
        yield RunFinding(NOTE, f"{first.node} logged {kind}{times}", detail, action, command, first.t_s)


def clock(t_s: float) -> str:
    """Format seconds as m:ss, or h:mm:ss."""
    minutes, seconds = divmod(int(t_s), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{seconds:02d}" if hours else f"{minutes}:{seconds:02d}"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}." if text else ""
