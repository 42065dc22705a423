"""Renders the page from its templates, styles, script and drawings."""

from __future__ import annotations

from lupin_runtime.report.findings import clock
from lupin_runtime.report.health import SENSORS
from lupin_runtime.report.images import heat_maps
from lupin_runtime.report.page.canvas import Canvas
from lupin_runtime.report.page.cards import figure_cards
from lupin_runtime.report.page.charts import charts
from lupin_runtime.report.page.environment import page_environment, script, script_json, styles
from lupin_runtime.report.page.legends import heat_ramps, layers, path_ramps, species_colors
from lupin_runtime.report.page.map_drawing import MapDrawing
from lupin_runtime.report.page.process_rows import process_rows
from lupin_runtime.report.page.replay import replay_data
from lupin_runtime.report.page.run_headers import outcome_of, run_facts
from lupin_runtime.report.page.tag_rows import tag_rows
from lupin_runtime.report.page.timeline_rows import timeline_rows
from lupin_runtime.report.report_json import ReportInput, figures


def render_page(report: ReportInput) -> str:
    """Return the page as HTML; it contains all its styles, scripts, images and data."""
    canvas = Canvas(report)
    heat = heat_maps(report.tags, report.log.map)
    drawings = charts(report)
    outcome = outcome_of(report)
    return (
        page_environment()
        .get_template("page.html.j2")
        .render(
            report=report,
            outcome=outcome,
            headline=_headline(report, outcome.label),
            facts=run_facts(report),
            sentence=report.facts.get("sentence") if report.state != "DONE" else None,
            cards=figure_cards(report),
            map=MapDrawing(report, canvas, heat),
            heat_choices=[(h.sensor, SENSORS[h.sensor].label) for h in heat],
            ramps=[*path_ramps(report), *heat_ramps(heat)],
            layers=layers(report),
            species=species_colors(report),
            timeline_rows=timeline_rows(report),
            tags=tag_rows(report),
            charts=drawings,
            processes=process_rows(report.facts),
            css=styles(),
            js=script("base.js", "charts.js", "map.js", "replay.js"),
            data=script_json(replay_data(report, canvas) | {"charts": [chart.data() for chart in drawings]}),
        )
    )


def _headline(report: ReportInput, outcome: str) -> str:
    n = figures(report)
    duration = clock(n["mission_s"] or 0.0)
    if not report.log.mission_id:
        return f"{outcome} after {duration}, without a mission"
    goal = n["score_tags_reachable"] or n["score_tags_total"] or n["tags_seen"]
    return f"{outcome}: {n['tags_read']} of {goal} tags read in {duration}"
