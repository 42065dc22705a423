"""Small charts over the run's time, one idea each, all on the same axis. The drawings stretch; their text does not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lupin_runtime.report.content import Material
from lupin_runtime.report.findings import clock
from lupin_runtime.report.page.markup import esc, tag

_WIDTH, _HEIGHT = 600.0, 120.0
_MOST_POINTS = 1200

Points = Sequence[tuple[float, float]]


@dataclass(frozen=True)
class Series:
    """A line of a chart. `shape` is line, area, steps or stems."""

    name: str
    points: Points
    shape: str = "line"


@dataclass(frozen=True)
class Chart:
    """A chart: its title, unit, lines, and the least upper end of its scale."""

    title: str
    unit: str
    series: tuple[Series, ...]
    at_least: float = 0.0
    signed: bool = False
    percent: bool = False


def charts(material: Material) -> list[Chart]:
    """The charts that this run has data for."""
    log = material.log
    end_s = log.end_s
    found = sorted(tag.first_t_s for tag in log.discovered.values())
    read = sorted(item.read_s for item in material.tags if item.read_s is not None)
    every = [
        Chart(
            "Speed",
            "m/s",
            (
                Series("measured", [(t, v) for t, v, _ in log.speed], "area"),
                Series("commanded", [(t, v) for t, v, _ in log.command]),
            ),
            0.1,
        ),
        Chart(
            "Turning",
            "rad/s",
            (
                Series("measured", [(t, w) for t, _, w in log.speed], "area"),
                Series("commanded", [(t, w) for t, _, w in log.command]),
            ),
            0.2,
            signed=True,
        ),
        Chart(
            "Tags",
            "",
            (
                Series("discovered", _count_up(found, end_s), "steps"),
                Series("read", _count_up(read, end_s), "steps"),
            ),
            1.0,
        ),
        Chart("Mapped area", "m²", (Series("known", log.known_area, "area"),), 1.0),
        Chart(
            "Corrections by the map",
            "cm",
            (Series("step", [(c.t_s, c.distance_m * 100.0) for c in log.trajectory.corrections], "stems"),),
            5.0,
        ),
        Chart("Battery", "%", (Series("charge", [(t, v * 100.0) for t, v in log.battery]),), 100.0, percent=True),
    ]
    return [chart for chart in every if any(len(series.points) > 1 for series in chart.series)]


def _count_up(times: Sequence[float], end_s: float) -> list[tuple[float, float]]:
    if not times:
        return []
    return [(0.0, 0.0), *((t, float(n + 1)) for n, t in enumerate(times)), (end_s, float(len(times)))]


def chart_html(chart: Chart, duration_s: float) -> str:
    """One chart as a figure."""
    values = [v for series in chart.series for _, v in series.points]
    high = max([chart.at_least, *(abs(v) if chart.signed else v for v in values)])
    low = -high if chart.signed else 0.0
    lines = [tag("line", x1=0.0, x2=_WIDTH, y1=_y(0.0, low, high), y2=_y(0.0, low, high), class_="zero")]
    for index, series in enumerate(chart.series):
        lines += _drawn(series, index, duration_s, low, high)
    drawing = tag(
        "svg",
        *lines,
        viewBox=f"0 0 {_WIDTH:.0f} {_HEIGHT:.0f}",
        preserveAspectRatio="none",
        role="img",
        aria_label=_words(chart),
    )
    drawing += tag("span", class_="cursor", hidden=True)
    keys = (tag("span", esc(s.name), class_=f"key key-{i}") for i, s in enumerate(chart.series) if len(s.points) > 1)
    title = tag("figcaption", tag("b", esc(chart.title)), tag("span", esc(chart.unit), class_="unit"), *keys)
    scale = tag("span", _short(high), class_="high") + tag("span", _short(low), class_="low")
    ends = tag("div", tag("span", "0:00"), tag("span", clock(duration_s)), class_="ends")
    return tag("figure", title, tag("div", drawing, scale, class_="plot"), ends, class_="chart")


def _drawn(series: Series, index: int, duration_s: float, low: float, high: float) -> list[str]:
    points = series.points[:: max(1, len(series.points) // _MOST_POINTS)]
    if not points:
        return []
    placed = [(_WIDTH * t / max(duration_s, 1e-3), _y(v, low, high)) for t, v in points]
    base = _y(0.0, low, high)
    if series.shape == "stems":
        stems = "".join(f"M{x:.1f} {base:.1f}V{y:.1f}" for x, y in placed)
        return [tag("path", d=stems, class_=f"line line-{index}")]
    if series.shape == "steps":
        path = f"M{placed[0][0]:.1f} {placed[0][1]:.1f}" + "".join(f"H{x:.1f}V{y:.1f}" for x, y in placed[1:])
    else:
        path = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in placed)
    drawn = [tag("path", d=path, class_=f"line line-{index}")]
    if series.shape == "area":
        drawn.insert(0, tag("path", d=f"{path}V{base:.1f}H{placed[0][0]:.1f}Z", class_=f"area area-{index}"))
    return drawn


def _y(value: float, low: float, high: float) -> float:
    return _HEIGHT - 2.0 - (_HEIGHT - 4.0) * (value - low) / max(high - low, 1e-9)


def _short(value: float) -> str:
    return f"{value:.3g}"


def _words(chart: Chart) -> str:
    """What the chart shows, for those who don't see it."""
    parts = []
    for series in chart.series:
        values = [v for _, v in series.points]
        if values:
            parts.append(f"{series.name} from {min(values):.3g} to {max(values):.3g}, last {values[-1]:.3g}")
    return f"{chart.title} over time{f' in {chart.unit}' if chart.unit else ''}: {'; '.join(parts)}"
