"""What the template map.svg.j2 draws of a run. One unit is a centimeter, y points down."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lupin_runtime.geometry import Pose2
from lupin_runtime.report.clearance import ROBOT_LENGTH_M, ROBOT_WIDTH_M
from lupin_runtime.report.images import Extent, HeatMap, data_uri, known_extent, map_png
from lupin_runtime.report.page.canvas import Canvas
from lupin_runtime.report.page.map_labels import place_labels
from lupin_runtime.report.page.symbols import Point, path_data
from lupin_runtime.report.palette import SPECIES, SPECIES_OTHER, SPEED_RAMP, TIME_RAMP, ramp
from lupin_runtime.report.report_json import ReportInput, thin
from lupin_runtime.report.run_log import LoggedFlower
from lupin_runtime.report.tags import TagResult
from lupin_runtime.report.trajectory import speeds

_SEGMENTS = 240
_PATH_PERIOD_S = 0.2
OUTCOME_LABELS = {
    "read": "read",
    "unreachable": "not reached",
    "scan_failed": "reached, not read",
    "skipped": "skipped",
    "seen": "seen, not read",
}


@dataclass(frozen=True)
class MapDrawing:
    """A run's map with heat maps of some sensors. `id_prefix` distinguishes the ids of maps on one page.

    All positions are units of the canvas, and `from_s` is the time in seconds from which the robot knew what is drawn.
    """

    report: ReportInput
    canvas: Canvas
    heat: Sequence[HeatMap] = ()
    id_prefix: str = ""

    def pictures(self) -> Iterator[tuple[str, str, str, Extent]]:
        """Yield (CSS classes, color scheme or empty, data URI, extent) of the occupancy grid and the heat maps."""
        grid = self.report.log.map
        extent = known_extent(grid) if grid is not None else None
        if grid is not None and extent is not None:
            for theme in ("light", "dark"):
                yield f"grid {theme}", theme, data_uri(map_png(grid, extent, theme), "png"), extent
        for h in self.heat:
            yield f"heat heat-{h.sensor}", "", data_uri(h.png, "png"), h.extent

    def true_outlines(self) -> Iterator[list[Point]]:
        """Yield the corners of the simulator's walls and boxes."""
        truth = self.report.truth
        for item in [*(truth.get("walls") or ()), *(truth.get("boxes") or ())]:
            pose = self.report.map_from_world @ Pose2(float(item["x"]), float(item["y"]), float(item["yaw"]))
            depth, width = float(item["depth"]) / 2.0, float(item["width"]) / 2.0
            corners = (pose.apply(a * depth, b * width) for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1)))
            yield self.at_all(corners)

    def at_all(self, points: Iterable[Point]) -> list[Point]:
        """Return the places of points of the map frame."""
        return [self.canvas.at(*point) for point in points]

    def at_truth(self, item: Mapping[str, float]) -> Point:
        """Return the place of one of the simulator's things."""
        return self.canvas.at(*self.report.map_from_world.apply(float(item["x"]), float(item["y"])))

    def true_path(self) -> list[Point]:
        """Return at most some thousand points of the true path; none if it has no length."""
        path = self.report.true_path
        return [self.canvas.at(p.x, p.y) for p in path[:: max(1, len(path) // 3000)]] if len(path) > 1 else []

    def path(self) -> list[Point]:
        """Return the points of the path that the robot measured; none if it has no length."""
        path = self.report.log.trajectory
        return [self.canvas.at(float(path.x[i]), float(path.y[i])) for i in self._kept()] if len(path) > 1 else []

    def path_pieces(self) -> Iterator[tuple[list[Point], str, str]]:
        """Yield the path in pieces, each with its color by time and by speed."""
        points = self.path()
        if not points:
            return
        speed = speeds(self.report.log.trajectory)[self._kept()]
        top_speed = max(float(np.percentile(speed, 98)), 1e-6)
        step = max(1, math.ceil(len(points) / _SEGMENTS))
        for first in range(0, len(points) - 1, step):
            piece = slice(first, first + step + 1)
            by_time = ramp(TIME_RAMP, first / (len(points) - 1))
            yield points[piece], by_time, ramp(SPEED_RAMP, float(speed[piece].mean()) / top_speed)

    def _kept(self) -> list[int]:
        return thin(self.report.log.trajectory.t_s, _PATH_PERIOD_S)

    def corrections(self) -> Iterator[tuple[Point, float, float]]:
        """Yield (place, time in seconds, distance in meters) where the map moved the robot."""
        path = self.report.log.trajectory
        for step in path.corrections:
            pose = path.at(step.t_s)
            if step.distance_m >= 0.05 and pose is not None:
                yield self.canvas.at(pose.x, pose.y), step.t_s, step.distance_m

    def known_from_s(self, times_s: Mapping[str, float], item: TagResult) -> float:
        """Return when a part of a tag's plant was known, in seconds; as long as its tag if that was not recorded."""
        return round(times_s.get(item.tag_id, item.discovered_s or 0.0), 1)

    def judged_s(self, item: TagResult) -> float:
        """Return when a tag's outcome was known, in seconds."""
        attempted_s = item.read_s if item.read_s is not None else item.attempted_s
        return round(self.report.log.end_s if attempted_s is None else attempted_s, 1)

    def flower_color(self, flower: LoggedFlower) -> str:
        """Return the color of a flower's species."""
        return SPECIES.get(flower.species, SPECIES_OTHER)

    def labelled_tags(self, canvas: Canvas) -> Iterator[tuple[TagResult, Point, Point]]:
        """Yield the tags that have a place, with this place and their label's."""
        placed = [item for item in self.report.tags if item.pose is not None]
        for item, label in zip(placed, place_labels(placed, canvas)):
            assert item.pose is not None
            yield item, canvas.at(item.pose.x, item.pose.y), label

    def ends(self, canvas: Canvas) -> Iterator[tuple[str, float, Point]]:
        """Yield ("Start" or "End", time in seconds, center of the symbol)."""
        path = self.report.log.trajectory
        if not len(path):
            return
        for label, t_s, row, side in zip(("Start", "End"), self.report.mission_span_s, (0, -1), (-1.0, 1.0)):
            pose = path.at(t_s) or Pose2(*(float(column[row]) for column in (path.x, path.y, path.yaw)))
            x, y = canvas.at(pose.x, pose.y)
            # Start and end are often both at the dock, where the robot is drawn: the symbols go to either side of it.
            yield label, t_s, (x + (canvas.symbol_size + ROBOT_LENGTH_M * 50.0) * side, y)

    def robot(self) -> tuple[float, float, str, str] | None:
        """Return (half length, half width, path of the nose, transform) of the robot at the end of the path."""
        path = self.report.log.trajectory
        if not len(path):
            return None
        x, y = self.canvas.at(float(path.x[-1]), float(path.y[-1]))
        half_length, half_width = ROBOT_LENGTH_M * 50.0, ROBOT_WIDTH_M * 50.0
        back, side = half_length * 0.15, half_width * 0.5
        nose = path_data([(back, -side), (half_length * 0.8, 0.0), (back, side)]) + "Z"
        turn = -math.degrees(float(path.yaw[-1]))
        return half_length, half_width, nose, f"translate({x:.1f} {y:.1f}) rotate({turn:.1f})"

    def scale_length_m(self) -> float:
        """Return the length of the scale bar, in meters."""
        return next((m for m in (1.0, 2.0, 5.0) if m * 100.0 >= self.canvas.width * 0.08), 10.0)


def max_speed(report: ReportInput) -> float:
    """Return the speed at the upper end of the path's colors, m/s."""
    path = report.log.trajectory
    return float(np.percentile(speeds(path), 98)) if len(path) > 1 else 0.0


def anchor(tag_id: str) -> str:
    """Return a tag's id for use in a URL fragment: other characters than letters and digits become code points."""
    return "".join(c if c.isalnum() and c.isascii() else f"-{ord(c):x}" for c in tag_id)
