"""The run over time: the mission's states, targets and holds as bands, and events."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise

from lupin_runtime.report.run_log import MissionSample, RunLog

INFO, WARN, ERROR = "info", "warn", "error"
_SEVERITIES = (INFO, WARN, ERROR)
_NOTABLE_CORRECTION_M = 0.10


@dataclass(frozen=True)
class Band:
    """A period of time with a label."""

    from_s: float
    to_s: float
    label: str
    detail: str = ""


@dataclass(frozen=True)
class TimelineEvent:
    """An event. `kind` is lifecycle, tag, reading, stop, pause, battery, map, notice or log; `severity` info, warn or error."""

    t_s: float
    kind: str
    severity: str
    text: str
    tag_id: str = ""


@dataclass(frozen=True)
class Timeline:
    """Bands by row, and events ordered by time. `outages` are the times in which nothing arrived from the robot."""

    states: tuple[Band, ...]
    legs: tuple[Band, ...]
    flags: tuple[Band, ...]
    outages: tuple[Band, ...]
    events: tuple[TimelineEvent, ...]


def build_timeline(log: RunLog) -> Timeline:
    """Return the bands and events of a run."""
    end_s = log.end_s
    states = _bands(log.mission, end_s, lambda m: m.state)
    legs = _bands(log.mission, end_s, lambda m: f"{m.target}\n{m.phase}" if m.target and m.phase else "")
    flags: list[Band] = []
    for label, flag in (
        ("e-stop", lambda m: m.estop),
        ("paused", lambda m: m.paused and not m.estop),
        ("battery low", lambda m: m.battery_low),
    ):
        flags += [Band(b.from_s, b.to_s, label) for b in _bands(log.mission, end_s, lambda m, f=flag: "x" if f(m) else "")]
    return Timeline(
        tuple(states),
        tuple(Band(b.from_s, b.to_s, b.label.split("\n")[0], b.label.split("\n")[1]) for b in legs),
        tuple(sorted(flags, key=lambda band: band.from_s)),
        tuple(Band(outage.from_s, outage.to_s, "no link") for outage in log.link.outages),
        tuple(sorted(_events(log, states), key=lambda event: event.t_s)),
    )


def _bands(samples: list[MissionSample], end_s: float, label: Callable[..., str]) -> list[Band]:
    """Join consecutive samples with the same label; samples labeled "" make no band."""
    bands: list[Band] = []
    for sample, following in zip(samples, [*samples[1:], None]):
        name, to_s = label(sample), following.t_s if following is not None else end_s
        if not name:
            continue
        if bands and bands[-1].label == name and bands[-1].to_s == sample.t_s:
            bands[-1] = Band(bands[-1].from_s, to_s, name)
        else:
            bands.append(Band(sample.t_s, to_s, name))
    return bands


def _events(log: RunLog, states: Iterable[Band]) -> Iterable[TimelineEvent]:
    for band in states:
        yield TimelineEvent(band.from_s, "lifecycle", ERROR if band.label == "FAULT" else INFO, band.label)
    for tag_id, tag in log.discovered.items():
        yield TimelineEvent(tag.first_t_s, "tag", INFO, f"tag {tag_id} discovered", tag_id)
    for entry in log.observations:
        if entry.kind == "tag_reading" and entry.status == "ok":
            yield TimelineEvent(
                entry.t_s, "reading", INFO, f"tag {entry.tag_id} read ({len(entry.readings)} sensors)", entry.tag_id
            )
        elif entry.kind == "tag_reading":
            text = f"tag {entry.tag_id} {entry.status.replace('_', ' ')}"
            yield TimelineEvent(entry.t_s, "reading", WARN, f"{text}: {entry.detail}" if entry.detail else text, entry.tag_id)
        elif entry.flower is not None and entry.flower.anomaly:
            yield TimelineEvent(entry.t_s, "reading", WARN, f"bug seen at tag {entry.tag_id}", entry.tag_id)
    yield from _flag_events(log.mission)
    for step in log.trajectory.corrections:
        if step.distance_m >= _NOTABLE_CORRECTION_M:
            yield TimelineEvent(
                step.t_s, "map", INFO, f"the map corrected the robot's position by {step.distance_m * 100:.0f} cm"
            )


def _flag_events(samples: list[MissionSample]) -> Iterable[TimelineEvent]:
    for before, after in pairwise(samples):
        if after.estop != before.estop:
            text, severity = ("e-stop pressed", WARN) if after.estop else ("e-stop released", INFO)
            yield TimelineEvent(after.t_s, "stop", severity, text)
        elif after.paused != before.paused:
            yield TimelineEvent(after.t_s, "pause", INFO, "paused" if after.paused else "resumed")
        if after.battery_low != before.battery_low:
            text, severity = ("battery low", WARN) if after.battery_low else ("battery recovered", INFO)
            yield TimelineEvent(after.t_s, "battery", severity, text)
        if after.last_event and after.last_event != before.last_event and not after.estop:
            yield TimelineEvent(after.t_s, "notice", _SEVERITIES[min(after.severity, 2)], after.last_event)
