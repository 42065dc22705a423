"""Converts meters of the map frame to the drawing's units."""

from __future__ import annotations

from collections.abc import Iterable
from copy import copy

from lupin_runtime.report.images import Extent, known_extent
from lupin_runtime.report.report_json import ReportInput

_MARGIN_M = 0.4
# Share of the map's width: on a phone's 350 px, the tags' numbers are 10 px high.
_PHONE_SYMBOL = 0.028


class Canvas:
    """The drawing's extent and the size of its symbols, computed from the run's data.

    One unit of the drawing is a centimeter; y points down.
    """

    def __init__(self, report: ReportInput) -> None:
        log = report.log
        extent = known_extent(log.map) if log.map is not None else None
        for x, y in _points(report):
            extent = Extent(x, y, x, y) if extent is None else extent.grown_to(x, y)
        extent = extent or Extent(-1.0, -1.0, 1.0, 1.0)
        self.extent = Extent(extent.x0 - _MARGIN_M, extent.y0 - _MARGIN_M, extent.x1 + _MARGIN_M, extent.y1 + _MARGIN_M)
        # Symbols keep a readable size relative to the drawing, in small and in large greenhouses.
        self.symbol_size = max(9.0, self.width * 0.0125, self.height * 0.0125)

    def for_phone(self) -> Canvas:
        """Return the same canvas with symbols that can be read on a map as wide as a phone."""
        canvas = copy(self)
        canvas.symbol_size = max(self.symbol_size, self.width * _PHONE_SYMBOL)
        return canvas

    @property
    def width(self) -> float:
        """Width in centimeters."""
        return self.extent.width * 100.0

    @property
    def height(self) -> float:
        """Height in centimeters."""
        return self.extent.height * 100.0

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Convert a point of the map frame to the canvas."""
        return (x - self.extent.x0) * 100.0, (self.extent.y1 - y) * 100.0

    def box(self, extent: Extent) -> dict[str, float]:
        """Return x, y, width and height of an extent on the canvas."""
        left, top = self.at(extent.x0, extent.y1)
        return {"x": left, "y": top, "width": extent.width * 100.0, "height": extent.height * 100.0}


def _points(report: ReportInput) -> Iterable[tuple[float, float]]:
    path = report.log.trajectory
    if len(path):
        yield from ((float(path.x.min()), float(path.y.min())), (float(path.x.max()), float(path.y.max())))
    for tag in report.tags:
        if tag.pose is not None:
            yield tag.pose.x, tag.pose.y
        yield from tag.footprint
