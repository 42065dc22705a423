"""The time line: rows of bands and ticks, placed in percent of the run so that they fit any width."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from lupin_runtime.report.content import Material
from lupin_runtime.report.findings import clock
from lupin_runtime.report.page.markup import esc, tag
from lupin_runtime.report.palette import STATE_OTHER, STATES
from lupin_runtime.report.timeline import Band, Event

_EVENT_MARKS = {
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


def timeline_html(material: Material) -> str:
    """Rows for states, legs, flags and events, over one axis."""
    duration_s = max(material.log.end_s, 1e-3)
    bands = material.timeline
    rows = [
        _row("Mission", (_state_band(b, duration_s) for b in bands.states)) if bands.states else "",
        _row("Target", (_leg_band(b, duration_s) for b in bands.legs)) if bands.legs else "",
        _row("Held", (_flag_band(b, duration_s) for b in bands.flags)) if bands.flags else "",
        _row("Events", (_event_mark(e, duration_s) for e in bands.events)) if bands.events else "",
        _axis(duration_s),
    ]
    return tag("div", *rows, tag("div", id="playhead", class_="playhead", hidden=True), class_="timeline", id="timeline")


def _row(name: str, parts: Iterable[str]) -> str:
    return tag("div", tag("span", esc(name), class_="row-name"), tag("div", *parts, class_="row-track"), class_="row")


def _place(from_s: float, to_s: float, duration_s: float) -> str:
    left, width = 100.0 * from_s / duration_s, 100.0 * max(to_s - from_s, 0.0) / duration_s
    return f"left:{left:.3f}%;width:{width:.3f}%"


def _state_band(band: Band, duration_s: float) -> str:
    words = f"{band.label}, {clock(band.from_s)} to {clock(band.to_s)}"
    style = f"{_place(band.from_s, band.to_s, duration_s)};--state:{STATES.get(band.label, STATE_OTHER)}"
    return tag("span", tag("b", esc(band.label)), class_="band state", style=style, title=words)


def _leg_band(band: Band, duration_s: float) -> str:
    words = f"tag {band.label}: {band.detail.lower()}, {clock(band.from_s)} to {clock(band.to_s)}"
    css = f"band leg phase-{band.detail.lower()}" if band.detail.isalpha() else "band leg"
    return tag("span", tag("b", esc(band.label)), class_=css, style=_place(band.from_s, band.to_s, duration_s), title=words)


def _flag_band(band: Band, duration_s: float) -> str:
    words = f"{band.label}, {clock(band.from_s)} to {clock(band.to_s)}"
    css = f"band flag flag-{band.label.replace(' ', '-')}"
    return tag("span", tag("b", esc(band.label)), class_=css, style=_place(band.from_s, band.to_s, duration_s), title=words)


def _event_mark(event: Event, duration_s: float) -> str:
    style = f"left:{100.0 * event.t_s / duration_s:.3f}%"
    css = f"event kind-{event.kind} severity-{event.severity}"
    words = f"{clock(event.t_s)} {event.text}"
    mark = _EVENT_MARKS.get(event.kind, "·")
    return tag("span", mark, class_=css, style=style, title=words, data_t=round(event.t_s, 1))


def _axis(duration_s: float) -> str:
    step = next((s for s in _TICKS_S if duration_s / s <= 8), _TICKS_S[-1])
    ticks = (
        tag("span", clock(t), class_="tick", style=f"left:{100.0 * t / duration_s:.3f}%")
        for t in range(0, int(duration_s * 0.965) + 1, step)
    )
    return _row("", ticks).replace('class="row"', 'class="row axis"', 1)


def event_list(events: Sequence[Event]) -> str:
    """All events in words, for those who read instead of hovering."""
    items = (
        tag(
            "li",
            tag("time", clock(e.t_s)),
            tag("span", esc(_EVENT_MARKS.get(e.kind, "·")), class_=f"mark severity-{e.severity}", aria_hidden="true"),
            tag("span", esc(e.text)),
            data_t=round(e.t_s, 1),
        )
        for e in events
    )
    return tag("ol", *items, class_="events")
