"""Renders the page from its templates, styles, script and drawings."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from lupin_runtime.report.findings import clock
from lupin_runtime.report.health import SENSORS
from lupin_runtime.report.images import heat_maps
from lupin_runtime.report.page.canvas import Canvas
from lupin_runtime.report.page.cards import figure_cards
from lupin_runtime.report.page.charts import charts
from lupin_runtime.report.page.legends import heat_ramps, layers, path_ramps, species_colors
from lupin_runtime.report.page.map_svg import draw_map
from lupin_runtime.report.page.markup import script_json
from lupin_runtime.report.page.process_rows import process_rows
from lupin_runtime.report.page.replay import replay_data
from lupin_runtime.report.page.tag_rows import tag_rows
from lupin_runtime.report.page.timeline_rows import EVENT_MARKS, timeline_rows
from lupin_runtime.report.palette import HEALTH
from lupin_runtime.report.report_json import ReportInput, figures

_FOLDER = Path(__file__).parent
_SEVERITY_LABELS = {"error": ("✖", "Problem"), "warn": ("▲", "Warning"), "note": ("●", "Note"), "good": ("✔", "Good")}


@dataclass(frozen=True)
class _Outcome:
    """How the page shows a run's end: CSS class, mark and label."""

    css: str
    mark: str
    label: str


_OUTCOMES = {
    "DONE": _Outcome("done", "✔", "Mission done"),
    "FAULT": _Outcome("fault", "✖", "Mission failed"),
    "LOST": _Outcome("fault", "✖", "Stack lost"),
    "NEVER_UP": _Outcome("fault", "✖", "Stack never came up"),
    "REFUSED": _Outcome("fault", "✖", "Mission refused"),
    "INTERRUPTED": _Outcome("open", "◼", "Interrupted"),
}


def render_page(report: ReportInput) -> str:
    """Return the page as HTML; it contains all its styles, scripts, images and data."""
    canvas = Canvas(report)
    heat = heat_maps(report.tags, report.log.map)
    outcome = _OUTCOMES.get(report.state, _Outcome("open", "◼", f"Ended in {report.state}"))
    return (
        _environment()
        .get_template("page.html.j2")
        .render(
            report=report,
            outcome=outcome,
            headline=_headline(report, outcome.label),
            facts=_facts(report),
            sentence=report.facts.get("sentence") if report.state != "DONE" else None,
            cards=figure_cards(report),
            map=draw_map(report, canvas, heat),
            heat_choices=[(h.sensor, SENSORS[h.sensor].label) for h in heat],
            ramps=[*path_ramps(report), *heat_ramps(heat)],
            layers=layers(report),
            species=species_colors(report),
            timeline_rows=timeline_rows(report),
            tags=tag_rows(report),
            charts=charts(report),
            processes=process_rows(report.facts),
            css=Markup(_read("page.css") + _health_colors()),
            js=Markup(_read("page.js")),
            data=script_json(replay_data(report, canvas)),
        )
    )


@cache
def _environment() -> Environment:
    environment = Environment(loader=FileSystemLoader(_FOLDER), autoescape=True, undefined=StrictUndefined)
    environment.filters["clock"] = clock
    environment.globals.update(severity_labels=_SEVERITY_LABELS, event_marks=EVENT_MARKS)
    return environment


def _read(name: str) -> str:
    return (_FOLDER / name).read_text(encoding="utf-8")


def _health_colors() -> str:
    """Return the palette's health colors as CSS variables."""
    return ":root{" + "".join(f"--health-{name}:{color};" for name, color in HEALTH.items()) + "}"


def _headline(report: ReportInput, outcome: str) -> str:
    n = figures(report)
    duration = clock(n["mission_s"] or 0.0)
    if not report.log.mission_id:
        return f"{outcome} after {duration}, without a mission"
    goal = n["score_tags_reachable"] or n["score_tags_total"] or n["tags_seen"]
    return f"{outcome}: {n['tags_read']} of {goal} tags read in {duration}"


def _facts(report: ReportInput) -> list[tuple[str, object]]:
    """Return what is known of the run's place, time and mission."""
    started = str(report.metadata.get("started_at", "")).replace("T", " ").replace("+00:00", " UTC")
    facts = (
        ("Run", report.run_id),
        ("World", report.fact("world")),
        ("Target", report.fact("target")),
        ("Mission", report.log.mission_id),
        ("Started", started),
    )
    return [(name, value) for name, value in facts if value]
