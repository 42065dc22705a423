"""The rows of the page's timeline: bands and marks, positioned in percent of the run so that they fit every width."""

from __future__ import annotations

from dataclasses import dataclass

from lupin_runtime.report.findings import clock
from lupin_runtime.report.palette import STATE_OTHER, STATES
from lupin_runtime.report.report_json import ReportInput
from lupin_runtime.report.timeline import Band, TimelineEvent

EVENT_MARKS = {
    "lifecycle": "▸",
    "tag": "◇",
    "reading": "◆",
    "stop": "■",
    "pause": "❚",
    "battery": "▽",
    "map": "⟳",
    "notice": "!",
    "log": "·",
}
_TICKS_S = (5, 10, 15, 30, 60, 120, 300, 600, 1800, 3600, 7200)
_MAX_TICKS = 8


@dataclass(frozen=True)
class Mark:
    """A band, event or tick: its text, CSS classes and style, tooltip, and time (events only)."""

    text: str
    css: str
    style: str
    title: str = ""
    t_s: float | None = None
    is_band: bool = True


@dataclass(frozen=True)
class Row:
    """One row of the timeline."""

    name: str
    marks: tuple[Mark, ...]
    css: str = "row"


def timeline_rows(report: ReportInput) -> list[Row]:
    """Return the rows for states, targets, holds, the link and events that are not empty, and the axis."""
    duration_s = max(report.log.end_s, 1e-3)
    timeline = report.timeline
    rows = [
        Row("Mission", tuple(_state_mark(band, duration_s) for band in timeline.states)),
        Row("Target", tuple(_leg_mark(band, duration_s) for band in timeline.legs)),
        Row("Held", tuple(_flag_mark(band, duration_s) for band in timeline.flags)),
        Row("Link", tuple(_flag_mark(band, duration_s) for band in timeline.outages)),
        Row("Events", tuple(_event_mark(event, duration_s) for event in timeline.events)),
    ]
    return [*(row for row in rows if row.marks), _axis(duration_s)]


def _position(band: Band, duration_s: float) -> str:
    left, width = 100.0 * band.from_s / duration_s, 100.0 * max(band.to_s - band.from_s, 0.0) / duration_s
    return f"left:{left:.3f}%;width:{width:.3f}%"


def _times(band: Band) -> str:
    return f"{clock(band.from_s)} to {clock(band.to_s)}"


def _state_mark(band: Band, duration_s: float) -> Mark:
    style = f"{_position(band, duration_s)};--state:{STATES.get(band.label, STATE_OTHER)}"
    return Mark(band.label, "band state", style, f"{band.label}, {_times(band)}")


def _leg_mark(band: Band, duration_s: float) -> Mark:
    css = f"band leg phase-{band.detail.lower()}" if band.detail.isalpha() else "band leg"
    return Mark(band.label, css, _position(band, duration_s), f"tag {band.label}: {band.detail.lower()}, {_times(band)}")


def _flag_mark(band: Band, duration_s: float) -> Mark:
    css = f"band flag flag-{band.label.replace(' ', '-')}"
    return Mark(band.label, css, _position(band, duration_s), f"{band.label}, {_times(band)}")


def _event_mark(event: TimelineEvent, duration_s: float) -> Mark:
    style = f"left:{100.0 * event.t_s / duration_s:.3f}%"
    css = f"event kind-{event.kind} severity-{event.severity}"
    title = f"{clock(event.t_s)} {event.text}"
    return Mark(EVENT_MARKS.get(event.kind, "·"), css, style, title, round(event.t_s, 1), is_band=False)


def _axis(duration_s: float) -> Row:
    step = next((s for s in _TICKS_S if duration_s / s <= _MAX_TICKS), _TICKS_S[-1])
    times = range(0, int(duration_s * 0.965) + 1, step)
    ticks = (Mark(clock(t), "tick", f"left:{100.0 * t / duration_s:.3f}%", is_band=False) for t in times)
    return Row("", tuple(ticks), "row axis")
