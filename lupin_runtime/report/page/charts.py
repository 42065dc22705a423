"""Small charts over the run's time, all on the same axis. The SVG stretches to the page's width; its labels are HTML.

The script shows the values at the pointer and zooms; it needs the points as data, too.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

from lupin_runtime.report.page.symbols import path_data
from lupin_runtime.report.report_json import ReportInput
from lupin_runtime.report.series import GAP_S, Points, TimeSeries, keep_extremes

_MAX_POINTS = 800


@dataclass(frozen=True)
class Series:
    """A line of a chart. `shape` is line, area, steps or stems; without a point for longer than `gap_s` it is interrupted."""

    name: str
    all_points: Points
    shape: str = "line"
    gap_s: float | None = None

    @cached_property
    def points(self) -> Points:
        """The points that are drawn."""
        return keep_extremes(self.all_points, _MAX_POINTS)

    def pieces(self) -> list[Points]:
        """Return the points between gaps."""
        points = self.points
        if self.gap_s is None:
            return [points] if points else []
        starts = [i for i, (t, _) in enumerate(points) if not i or t - points[i - 1][0] > self.gap_s]
        return [points[first:end] for first, end in zip(starts, [*starts[1:], len(points)])]


@dataclass(frozen=True)
class Chart:
    """A chart. Its scale ends at `min_high` or above, and is symmetric about 0 if `signed`; `missing` says why it is empty."""

    title: str
    unit: str
    series: tuple[Series, ...]
    min_high: float = 0.0
    signed: bool = False
    missing: str = ""

    WIDTH: ClassVar[float] = 600.0
    HEIGHT: ClassVar[float] = 120.0

    @property
    def is_drawn(self) -> bool:
        """Whether there is enough data to draw."""
        return any(len(series.points) > 1 for series in self.series)

    @cached_property
    def high(self) -> float:
        """The upper end of the scale."""
        return max([self.min_high, *(abs(v) if self.signed else v for s in self.series for _, v in s.points)])

    @property
    def low(self) -> float:
        """The lower end of the scale."""
        return -self.high if self.signed else 0.0

    def y(self, value: float) -> float:
        """Return the height of a value in the drawing; y points down."""
        return self.HEIGHT - 2.0 - (self.HEIGHT - 4.0) * (value - self.low) / max(self.high - self.low, 1e-9)

    def paths(self, duration_s: float) -> Iterator[tuple[str, str]]:
        """Yield (CSS classes, path data) of the series' areas and lines."""
        base = self.y(0.0)
        for index, series in enumerate(self.series):
            lines, areas = "", ""
            for piece in series.pieces():
                points = [(self.WIDTH * t / max(duration_s, 1e-3), self.y(v)) for t, v in piece]
                if series.shape == "stems":
                    lines += "".join(f"M{x:.1f} {base:.1f}V{y:.1f}" for x, y in points)
                    continue
                if series.shape == "steps":
                    path = path_data(points[:1]) + "".join(f"H{x:.1f}V{y:.1f}" for x, y in points[1:])
                else:
                    path = path_data(points)
                lines += path
                areas += f"{path}V{base:.1f}H{points[0][0]:.1f}Z" if series.shape == "area" else ""
            if areas:
                yield f"area area-{index}", areas
            if lines:
                yield f"line line-{index}", lines

    def data(self) -> dict[str, Any]:
        """Return plain data for the script: seconds, and values with four significant digits."""
        return {
            "unit": self.unit,
            "series": [
                {
                    "shape": series.shape,
                    "gap": series.gap_s,
                    "t": [round(t, 1) for t, _ in series.points],
                    "v": [float(f"{v:.4g}") for _, v in series.points],
                }
                for series in self.series
            ],
        }

    @property
    def description(self) -> str:
        """The chart in words, for screen readers."""
        parts = []
        for series in self.series:
            values = [v for _, v in series.points]
            if values:
                parts.append(f"{series.name} from {min(values):.3g} to {max(values):.3g}, last {values[-1]:.3g}")
        return f"{self.title} over time{f' in {self.unit}' if self.unit else ''}: {'; '.join(parts)}"


@dataclass(frozen=True)
class Quantity:
    """How a quantity of RunSeries, its `key`, is drawn; `scale` converts it to `unit`, `gap_s` interrupts its line."""

    key: str
    title: str
    name: str
    unit: str
    scale: float
    min_high: float
    gap_s: float | None = GAP_S

    def chart(self, names: Sequence[str], runs: Sequence[TimeSeries]) -> Chart:
        """Return the chart of one run or several, with their names. It says why a run lacks the quantity."""
        lines = tuple(
            Series(name or self.name, [(t, v * self.scale) for t, v in run.points], "line", self.gap_s)
            for name, run in zip(names, runs, strict=True)
        )
        reasons = [
            f"{name}: {reason}" if name else reason
            for name, run in zip(names, runs, strict=True)
            if (reason := run.missing or ("there is only one value" if len(run.points) < 2 else ""))
        ]
        return Chart(self.title, self.unit, lines, self.min_high, missing="; ".join(reasons))


QUANTITIES = (
    Quantity("localization_error_m", "Localization error", "distance to the truth", "cm", 100.0, 2.0),
    Quantity("clearance_m", "Clearance", "nearest obstacle", "m", 1.0, 0.5),
    Quantity("real_time_factor", "Real-time factor", "simulated per real second", "×", 1.0, 1.0, gap_s=None),
)


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
                Series("discovered", count_up(found, end_s), "steps"),
                Series("read", count_up(read, end_s), "steps"),
            ),
            1.0,
        ),
        *(quantity.chart(("",), (getattr(report.series, quantity.key),)) for quantity in QUANTITIES),
        Chart("Mapped area", "m²", (Series("known", log.known_area, "area"),), 1.0),
        Chart(
            "Corrections by the map",
            "cm",
            (Series("step", [(c.t_s, c.distance_m * 100.0) for c in log.trajectory.corrections], "stems"),),
            5.0,
        ),
        Chart("Battery", "%", (Series("charge", [(t, v * 100.0) for t, v in log.battery]),), 100.0),
    ]
    return [chart for chart in all_charts if chart.is_drawn or chart.missing]


def count_up(times: Sequence[float], end_s: float) -> list[tuple[float, float]]:
    """Return the points of a count that is 0 at first and grows by one at each of the times, which are sorted."""
    if not times:
        return []
    return [(0.0, 0.0), *((t, float(n + 1)) for n, t in enumerate(times)), (end_s, float(len(times)))]
