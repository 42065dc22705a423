"""The run as bands and events over time: what state it was in, which tag it went for, what happened."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise

from lupin_runtime.report.log import MissionSample, RunLog

INFO, WARN, ERROR = "info", "warn", "error"
_SEVERITIES = (INFO, WARN, ERROR)
# A correction of the map that a reader of the report should know of.
_NOTABLE_CORRECTION_M = 0.10


@dataclass(frozen=True)
class Band:
    """A stretch of time with one label; `detail` says more."""

    from_s: float
    to_s: float
    label: str
    detail: str = ""


@dataclass(frozen=True)
class Event:
    """Something that happened at one moment. `kind` is lifecycle, tag, reading, stop, pause, battery, map, notice or log."""

    t_s: float
    kind: str
    severity: str
    text: str
    tag_id: str = ""


@dataclass(frozen=True)
class Timeline:
    """Bands by row, and events in order of time."""

    states: tuple[Band, ...]
    legs: tuple[Band, ...]
    flags: tuple[Band, ...]
    events: tuple[Event, ...]


def timeline(log: RunLog) -> Timeline:
    """The bands and events of a run."""
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
        tuple(sorted(_events(log, states), key=lambda event: event.t_s)),
    )


def _bands(samples: list[MissionSample], end_s: float, label: Callable[..., str]) -> list[Band]:
    """Consecutive samples of one label, joined; "" makes no band."""
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


def _events(log: RunLog, states: Iterable[Band]) -> Iterable[Event]:
    for band in states:
        yield Event(band.from_s, "lifecycle", ERROR if band.label == "FAULT" else INFO, band.label)
    for tag_id, tag in log.discovered.items():
        yield Event(tag.first_t_s, "tag", INFO, f"tag {tag_id} discovered", tag_id)
    for seen in log.seen:
        if seen.kind == "tag_reading" and seen.status == "ok":
            yield Event(seen.t_s, "reading", INFO, f"tag {seen.tag_id} read ({len(seen.readings)} sensors)", seen.tag_id)
        elif seen.kind == "tag_reading":
            words = f"tag {seen.tag_id} {seen.status.replace('_', ' ')}"
            yield Event(seen.t_s, "reading", WARN, f"{words}: {seen.detail}" if seen.detail else words, seen.tag_id)
        elif seen.flower is not None and seen.flower.anomaly:
            yield Event(seen.t_s, "reading", WARN, f"bug seen at tag {seen.tag_id}", seen.tag_id)
    yield from _flag_events(log.mission)
    for step in log.trajectory.corrections:
        if step.distance_m >= _NOTABLE_CORRECTION_M:
            yield Event(step.t_s, "map", INFO, f"the map corrected the robot's place by {step.distance_m * 100:.0f} cm")


def _flag_events(samples: list[MissionSample]) -> Iterable[Event]:
    for before, now in pairwise(samples):
        if now.estop != before.estop:
            words = ("e-stop pressed", WARN) if now.estop else ("e-stop released", INFO)
            yield Event(now.t_s, "stop", words[1], words[0])
        elif now.paused != before.paused:
            yield Event(now.t_s, "pause", INFO, "paused" if now.paused else "resumed")
        if now.battery_low != before.battery_low:
            words = ("battery low", WARN) if now.battery_low else ("battery recovered", INFO)
            yield Event(now.t_s, "battery", words[1], words[0])
        if now.last_event and now.last_event != before.last_event and not now.estop:
            yield Event(now.t_s, "notice", _SEVERITIES[min(now.severity, 2)], now.last_event)
