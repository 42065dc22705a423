"""The map of a run as SVG: occupancy, path, tags, flowers and truth. One unit is a centimeter, y points down."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from markupsafe import Markup

from lupin_runtime.geometry import Pose2
from lupin_runtime.report.clearance import ROBOT_LENGTH_M, ROBOT_WIDTH_M
from lupin_runtime.report.findings import clock
from lupin_runtime.report.images import HeatMap, data_uri, known_extent, map_png
from lupin_runtime.report.page.canvas import Canvas
from lupin_runtime.report.page.map_labels import place_labels
from lupin_runtime.report.page.markup import element, join, path_data
from lupin_runtime.report.page.symbols import bug_path, cross_path, diamond_path, tag_plate
from lupin_runtime.report.palette import SPECIES, SPECIES_OTHER, SPEED_RAMP, TIME_RAMP, ramp, species_label
from lupin_runtime.report.report_json import ReportInput, thin
from lupin_runtime.report.run_log import LoggedPot
from lupin_runtime.report.tags import READ, TagResult
from lupin_runtime.report.trajectory import speeds
from lupin_runtime.twin.health import shown_state

_SEGMENTS = 240
_PATH_PERIOD_S = 0.2
OUTCOME_LABELS = {
    "read": "read",
    "unreachable": "not reached",
    "scan_failed": "reached, not read",
    "skipped": "skipped",
    "seen": "seen, not read",
}


def draw_map(report: ReportInput, canvas: Canvas, heat: Sequence[HeatMap], id_prefix: str = "") -> Markup:
    """Return the map; later layers cover earlier ones.

    The attribute `data-from` is the time in seconds from which the robot knew what is drawn. Symbols with text are drawn twice:
    a style sheet chooses those for wide screens or those for phones. `id_prefix` distinguishes the ids of maps on one page.
    """
    phone = canvas.for_phone()
    layers = [
        _grid_layer(report, canvas),
        *(canvas.image(data_uri(h.png, "png"), h.extent, f"heat heat-{h.sensor}") for h in heat),
        element("g", *_truth_layer(report, canvas), class_="layer truth"),
        element("g", *_box_layer(report, canvas), class_="layer boxes"),
        element("g", *_path_layer(report, canvas), class_="layer path"),
        element("g", *_flower_layer(report, canvas), class_="layer flowers"),
        element("path", id=f"{id_prefix}scan", class_="scan", d="M0 0"),
        _robot_symbol(report, canvas, id_prefix),
        element("g", *_symbols(report, canvas), class_="for-wide"),
        element("g", *_symbols(report, phone), class_="for-phone"),
    ]
    count = sum(item.pose is not None for item in report.tags)
    label = f"Map, {canvas.extent.width:.1f} by {canvas.extent.height:.1f} meters, with the path driven and {count} tags"
    return element(
        "svg",
        *layers,
        id=f"{id_prefix}map",
        class_="map",
        viewBox=f"0 0 {canvas.width:.0f} {canvas.height:.0f}",
        style=f"--sign-wide:{canvas.symbol_size:.1f}px;--sign-phone:{phone.symbol_size:.1f}px;aspect-ratio:{canvas.width:.0f}/{canvas.height:.0f}",
        role="img",
        aria_label=label,
    )


def _symbols(report: ReportInput, canvas: Canvas) -> Iterable[Markup]:
    yield element("g", *_end_layer(report, canvas), class_="layer ends")
    yield element("g", *_tag_layer(report, canvas), class_="layer tags")
    yield _scale_bar(canvas)


def _grid_layer(report: ReportInput, canvas: Canvas) -> Markup:
    grid = report.log.map
    extent = known_extent(grid) if grid is not None else None
    if grid is None or extent is None:
        return Markup("")
    return join(
        canvas.image(data_uri(map_png(grid, extent, theme), "png"), extent, f"grid {theme}", data_theme=theme)
        for theme in ("light", "dark")
    )


def _path_layer(report: ReportInput, canvas: Canvas) -> Iterable[Markup]:
    """Draw the path in pieces, each with its color by time and by speed; a halo keeps it readable on walls."""
    path = report.log.trajectory
    if len(path) < 2:
        return
    keep = thin(path.t_s, _PATH_PERIOD_S)
    points = [canvas.at(float(path.x[i]), float(path.y[i])) for i in keep]
    speed = speeds(path)[keep]
    top_speed = max(float(np.percentile(speed, 98)), 1e-6)
    yield element("path", d=path_data(points), class_="halo")
    step = max(1, math.ceil(len(points) / _SEGMENTS))
    for first in range(0, len(points) - 1, step):
        piece = points[first : first + step + 1]
        by_time = ramp(TIME_RAMP, first / (len(points) - 1))
        by_speed = ramp(SPEED_RAMP, float(speed[first : first + step + 1].mean()) / top_speed)
        yield element("path", d=path_data(piece), class_="leg", style=f"--time:{by_time};--speed:{by_speed}")
    for step_ in path.corrections:
        pose = path.at(step_.t_s)
        if step_.distance_m >= 0.05 and pose is not None:
            x, y = canvas.at(pose.x, pose.y)
            label = f"{clock(step_.t_s)}: the map corrected the robot's position by {step_.distance_m * 100:.0f} cm"
            diamond = diamond_path(x, y, canvas.symbol_size * 0.55)
            yield element("path", element("title", label), d=diamond, class_="correction", data_from=round(step_.t_s, 1))


def max_speed(report: ReportInput) -> float:
    """Return the speed at the upper end of the path's colors, m/s."""
    path = report.log.trajectory
    return float(np.percentile(speeds(path), 98)) if len(path) > 1 else 0.0


def _box_layer(report: ReportInput, canvas: Canvas) -> Iterable[Markup]:
    for item in report.tags:
        if item.footprint:
            points = " ".join(f"{x:.1f},{y:.1f}" for x, y in (canvas.at(*point) for point in item.footprint))
            title = element("title", f"Flower box of tag {item.tag_id}")
            yield element("polygon", title, points=points, data_from=_known_from(report.log.first_box_s, item))


def _flower_layer(report: ReportInput, canvas: Canvas) -> Iterable[Markup]:
    for item in report.tags:
        if item.flower:
            pot = _flowers(item.tag_id, item.flower, canvas)
            yield element("g", *pot, class_="pot", data_from=_known_from(report.log.first_flower_s, item))


def _known_from(times_s: Mapping[str, float], item: TagResult) -> float:
    """Return when a part of a tag's plant was known, in seconds; as long as its tag if that was not recorded."""
    return round(times_s.get(item.tag_id, item.discovered_s or 0.0), 1)


def _flowers(tag_id: str, pot: LoggedPot, canvas: Canvas) -> Iterable[Markup]:
    radius = canvas.symbol_size * 0.42
    for flower in pot.placed:
        x, y = canvas.at(flower.x, flower.y)
        label = f"{species_label(flower.species)} at tag {tag_id}, {flower.confidence:.0%} confidence"
        title = element("title", f"{label}, bug" if flower.anomaly else label)
        fill = SPECIES.get(flower.species, SPECIES_OTHER)
        yield element("circle", title, cx=x, cy=y, r=radius, fill=fill, class_="flower")
        if flower.anomaly:
            yield element("path", d=bug_path(x + radius, y - radius, radius), class_="bug")


def _tag_layer(report: ReportInput, canvas: Canvas) -> Iterable[Markup]:
    placed = [item for item in report.tags if item.pose is not None]
    for item, (label_x, label_y) in zip(placed, place_labels(placed, canvas)):
        assert item.pose is not None
        x, y = canvas.at(item.pose.x, item.pose.y)
        label = f"Tag {item.tag_id}: {OUTCOME_LABELS[item.outcome]}"
        health = shown_state(item.health, item.worst_deviation)
        if item.readings:
            label += f", {health.replace('_', ' ')}"
        parts = [element("title", label), element("line", x1=x, y1=y, x2=label_x, y2=label_y, class_="leader")]
        parts.append(tag_plate(x, y, item.pose.facing_rad, canvas.symbol_size))
        parts.append(element("circle", cx=label_x, cy=label_y, r=canvas.symbol_size * 0.95, class_=f"pin health-{health}"))
        parts.append(element("text", item.tag_id, x=label_x, y=label_y, class_="pin-text"))
        if item.outcome != READ:
            offset = canvas.symbol_size * 0.8
            parts.append(element("path", d=cross_path(label_x + offset, label_y - offset, canvas.symbol_size * 0.35)))
        css = f"tag outcome-{item.outcome}"
        attempted_s = item.read_s if item.read_s is not None else item.attempted_s
        judged_s = report.log.end_s if attempted_s is None else attempted_s
        times = {"data_from": round(item.discovered_s or 0.0, 1), "data_judged": round(judged_s, 1)}
        yield element("a", *parts, href=f"#tag-{anchor(item.tag_id)}", class_=css, data_tag=item.tag_id, **times)


def _end_layer(report: ReportInput, canvas: Canvas) -> Iterable[Markup]:
    path = report.log.trajectory
    if not len(path):
        return
    begin_s, end_s = report.mission_span_s
    for css, t_s, letter, label in (("start", begin_s, "S", "Start"), ("end", end_s, "E", "End")):
        pose = path.at(t_s) or Pose2(*(float(column[0 if css == "start" else -1]) for column in (path.x, path.y, path.yaw)))
        x, y = canvas.at(pose.x, pose.y)
        # Start and end are often both at the dock, where the robot is drawn: the symbols go to either side of it.
        x += (canvas.symbol_size + ROBOT_LENGTH_M * 50.0) * (-1.0 if css == "start" else 1.0)
        s = canvas.symbol_size * 0.8
        parts = [
            element("title", f"{label} of the mission, {clock(t_s)}"),
            element("rect", x=x - s, y=y - s, width=2 * s, height=2 * s, rx=s * 0.4),
        ]
        text = element("text", letter, x=x, y=y)
        yield element("g", *parts, text, class_=f"end {css}", data_from=round(t_s, 1))


def _truth_layer(report: ReportInput, canvas: Canvas) -> Iterable[Markup]:
    """Draw the outlines of the simulator's walls, boxes, pillars and tags, and the true path."""
    truth, frame = report.truth, report.map_from_world
    for item in [*(truth.get("walls") or ()), *(truth.get("boxes") or ())]:
        pose = frame @ Pose2(float(item["x"]), float(item["y"]), float(item["yaw"]))
        depth, width = float(item["depth"]) / 2.0, float(item["width"]) / 2.0
        corners = (pose.apply(a * depth, b * width) for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1)))
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in (canvas.at(*corner) for corner in corners))
        yield element("polygon", points=points)
    for item in truth.get("pillars") or ():
        x, y = canvas.at(*frame.apply(float(item["x"]), float(item["y"])))
        yield element("circle", cx=x, cy=y, r=float(item["radius"]) * 100.0)
    if len(report.true_path) > 1:
        step = max(1, len(report.true_path) // 3000)
        yield element("path", d=path_data(canvas.at(p.x, p.y) for p in report.true_path[::step]), class_="true-path")
    for item in truth.get("tags") or ():
        x, y = canvas.at(*frame.apply(float(item["x"]), float(item["y"])))
        title = element("title", f"True position of tag {item['id']}")
        yield element("path", title, d=cross_path(x, y, canvas.symbol_size * 0.5), class_="true-tag")


def _robot_symbol(report: ReportInput, canvas: Canvas, id_prefix: str) -> Markup:
    """Draw the robot at the end of the path; the time slider moves it."""
    path = report.log.trajectory
    if not len(path):
        return Markup("")
    x, y = canvas.at(float(path.x[-1]), float(path.y[-1]))
    half_length, half_width = ROBOT_LENGTH_M * 50.0, ROBOT_WIDTH_M * 50.0
    body = element("rect", x=-half_length, y=-half_width, width=2 * half_length, height=2 * half_width, rx=5)
    back, side = half_length * 0.15, half_width * 0.5
    nose = element("path", d=path_data([(back, -side), (half_length * 0.8, 0.0), (back, side)]) + "Z")
    turn = -math.degrees(float(path.yaw[-1]))
    return element(
        "g", body, nose, id=f"{id_prefix}robot", class_="robot", transform=f"translate({x:.1f} {y:.1f}) rotate({turn:.1f})"
    )


def _scale_bar(canvas: Canvas) -> Markup:
    length = next((m for m in (1.0, 2.0, 5.0) if m * 100.0 >= canvas.width * 0.08), 10.0)
    x, y = canvas.symbol_size, canvas.height - canvas.symbol_size
    bar = element("path", d=f"M{x:.1f} {y - 4:.1f}v8M{x:.1f} {y:.1f}h{length * 100:.0f}m0 -4v8")
    label = element("text", f"{length:.0f} m", x=x + length * 100 + canvas.symbol_size * 0.6, y=y)
    return element("g", bar, label, class_="scale")


def anchor(tag_id: str) -> str:
    """Return a tag's id for use in a URL fragment: other characters than letters and digits become code points."""
    return "".join(c if c.isalnum() and c.isascii() else f"-{ord(c):x}" for c in tag_id)
