"""Small charts over the run's time, all on the same axis. The SVG stretches to the page's width; its labels are HTML."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from lupin_runtime.report.page.markup import element, join
from lupin_runtime.report.report_json import ReportInput

_WIDTH, _HEIGHT = 600.0, 120.0
_MAX_POINTS = 1200

Points = Sequence[tuple[float, float]]


@dataclass(frozen=True)
class Series:
    """A line of a chart. `shape` is line, area, steps or stems."""

    name: str
    points: Points
    shape: str = "line"


@dataclass(frozen=True)
class Chart:
    """A chart. Its scale ends at `min_high` or above, and is symmetric about 0 if `signed`."""

    title: str
    unit: str
    series: tuple[Series, ...]
    min_high: float = 0.0
    signed: bool = False

    @property
    def high(self) -> float:
        """The upper end of the scale."""
        return max([self.min_high, *(abs(v) if self.signed else v for s in self.series for _, v in s.points)])

    @property
    def low(self) -> float:
        """The lower end of the scale."""
        return -self.high if self.signed else 0.0

    def svg(self, duration_s: float) -> Markup:
        """Return the drawing."""
        low, high = self.low, self.high
        lines = [element("line", x1=0.0, x2=_WIDTH, y1=_y(0.0, low, high), y2=_y(0.0, low, high), class_="zero")]
        for index, series in enumerate(self.series):
            lines += _draw_series(series, index, duration_s, low, high)
        return element(
            "svg",
            join(lines),
            viewBox=f"0 0 {_WIDTH:.0f} {_HEIGHT:.0f}",
            preserveAspectRatio="none",
            role="img",
            aria_label=self._description(),
        )

    def _description(self) -> str:
        """Describe the chart for screen readers."""
        parts = []
        for series in self.series:
            values = [v for _, v in series.points]
            if values:
                parts.append(f"{series.name} from {min(values):.3g} to {max(values):.3g}, last {values[-1]:.3g}")
        return f"{self.title} over time{f' in {self.unit}' if self.unit else ''}: {'; '.join(parts)}"


def charts(report: ReportInput) -> list[Chart]:
    """Return the charts that this run has data for."""
    log = report.log
    end_s = log.end_s
    found = sorted(tag.first_t_s for tag in log.discovered.values())
    read = sorted(item.read_s for item in report.tags if item.read_s is not None)
    all_charts = [
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
        Chart("Battery", "%", (Series("charge", [(t, v * 100.0) for t, v in log.battery]),), 100.0),
    ]
    return [chart for chart in all_charts if any(len(series.points) > 1 for series in chart.series)]


def _count_up(times: Sequence[float], end_s: float) -> list[tuple[float, float]]:
    if not times:
        return []
    return [(0.0, 0.0), *((t, float(n + 1)) for n, t in enumerate(times)), (end_s, float(len(times)))]


def _draw_series(series: Series, index: int, duration_s: float, low: float, high: float) -> list[Markup]:
    points = series.points[:: max(1, len(series.points) // _MAX_POINTS)]
    if not points:
        return []
    points_xy = [(_WIDTH * t / max(duration_s, 1e-3), _y(v, low, high)) for t, v in points]
    base = _y(0.0, low, high)
    if series.shape == "stems":
        stems = "".join(f"M{x:.1f} {base:.1f}V{y:.1f}" for x, y in points_xy)
        return [element("path", d=stems, class_=f"line line-{index}")]
    if series.shape == "steps":
        path = f"M{points_xy[0][0]:.1f} {points_xy[0][1]:.1f}" + "".join(f"H{x:.1f}V{y:.1f}" for x, y in points_xy[1:])
    else:
        path = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points_xy)
    elements = [element("path", d=path, class_=f"line line-{index}")]
    if series.shape == "area":
        elements.insert(0, element("path", d=f"{path}V{base:.1f}H{points_xy[0][0]:.1f}Z", class_=f"area area-{index}"))
    return elements


def _y(value: float, low: float, high: float) -> float:
    return _HEIGHT - 2.0 - (_HEIGHT - 4.0) * (value - low) / max(high - low, 1e-9)
