"""Renders the page that compares two runs. It shares styles, charts and maps with a report's page."""

from __future__ import annotations

from dataclasses import dataclass

from lupin_runtime.report.comparison import A, B, Comparison, TagPair, TagSide, figure_texts, tag_text
from lupin_runtime.report.findings import clock
from lupin_runtime.report.page.canvas import Canvas
from lupin_runtime.report.page.charts import QUANTITIES, Chart, Series, count_up
from lupin_runtime.report.page.environment import page_environment, script, script_json, styles
from lupin_runtime.report.page.map_drawing import MapDrawing
from lupin_runtime.report.page.run_headers import outcome_of, run_facts
from lupin_runtime.report.page.tag_rows import OUTCOME_MARKS
from lupin_runtime.report.report_json import ReportInput, figures


@dataclass(frozen=True)
class ValueRow:
    """A row of a table: a name, the texts of A and B, and how they differ; `better` is A, B or empty."""

    name: str
    a: str
    b: str
    difference: str
    better: str = ""


def render_comparison(comparison: Comparison) -> str:
    """Return the page as HTML; it contains all its styles, scripts, images and data."""
    drawings = _charts(comparison)
    end_s = max(comparison.a.log.end_s, comparison.b.log.end_s, 1e-3)
    reports = ((A, comparison.a), (B, comparison.b))
    return (
        page_environment()
        .get_template("comparison.html.j2")
        .render(
            comparison=comparison,
            sides=[(name, report, outcome_of(report), _headline(report), run_facts(report)[1:]) for name, report in reports],
            figures=_figure_rows(comparison),
            tags=[_tag_row(pair) for pair in comparison.tags],
            maps=[(name, report, MapDrawing(report, Canvas(report), id_prefix=f"{name.lower()}-")) for name, report in reports],
            charts=drawings,
            end_s=end_s,
            css=styles(),
            js=script("base.js", "charts.js"),
            data=script_json({"end": round(end_s, 1), "charts": [chart.data() for chart in drawings]}),
        )
    )


def _headline(report: ReportInput) -> str:
    n = figures(report)
    return f"{n['tags_read']} of {n['tags_seen']} tags read in {clock(n['mission_s'] or 0.0)}"


def _figure_rows(comparison: Comparison) -> list[ValueRow]:
    rows = [ValueRow("Outcome", comparison.a.state, comparison.b.state, "")]
    rows += [ValueRow(row.label, *figure_texts(row), row.better) for row in comparison.figures]
    return rows


def _tag_row(pair: TagPair) -> ValueRow:
    difference = "differs" if pair.differs else "same"
    if not pair.differs and pair.later_s is not None:
        difference = f"{pair.later_s:+.0f} s"
    return ValueRow(pair.tag_id, _tag_cell(pair.a), _tag_cell(pair.b), difference, pair.better)


def _tag_cell(side: TagSide | None) -> str:
    return tag_text(side) if side is None else f"{OUTCOME_MARKS[side.outcome]} {tag_text(side)}"


def _charts(comparison: Comparison) -> list[Chart]:
    """Return charts with a line of each run; time counts from the start of each recording."""
    reports = (comparison.a, comparison.b)
    read = Chart(
        "Tags read",
        "",
        tuple(Series(name, count_up(_read_times(report), report.log.end_s), "steps") for name, report in zip((A, B), reports)),
        1.0,
    )
    area = Chart("Mapped area", "m²", tuple(Series(name, r.log.known_area) for name, r in zip((A, B), reports)), 1.0)
    quantities = [q.chart((A, B), [getattr(report.series, q.key) for report in reports]) for q in QUANTITIES]
    return [chart for chart in (read, area, *quantities) if chart.is_drawn or chart.missing]


def _read_times(report: ReportInput) -> list[float]:
    return sorted(tag.read_s for tag in report.tags if tag.read_s is not None)
