"""The map of a run as SVG: what was mapped, where the robot drove, what it found. One unit is a centimetre, y points down."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from lupin_runtime.geometry import Pose2
from lupin_runtime.report.content import Material, thin
from lupin_runtime.report.findings import clock
from lupin_runtime.report.page.markup import esc, path_data, tag
from lupin_runtime.report.palette import SPECIES, SPECIES_OTHER, SPEED_RAMP, TIME_RAMP, ramp, species_label
from lupin_runtime.report.raster import Extent, HeatMap, data_uri, known_extent, map_png
from lupin_runtime.report.tags import READ, TagResult
from lupin_runtime.report.trajectory import speeds

_MARGIN_M = 0.4
_SEGMENTS = 240
_PATH_PERIOD_S = 0.2
# MIRTE Master's outline, for the robot that the time slider moves.
_ROBOT_LENGTH_M, _ROBOT_WIDTH_M = 0.32, 0.28
OUTCOME_WORDS = {
    "read": "read",
    "unreachable": "not reached",
    "scan_failed": "reached, not read",
    "skipped": "skipped",
    "seen": "seen, not read",
}


class Canvas:
    """The drawing's extent and the size of its signs, both taken from what is to be drawn."""

    def __init__(self, material: Material) -> None:
        log = material.log
        extent = known_extent(log.map) if log.map is not None else None
        for x, y in _points(material):
            extent = Extent(x, y, x, y) if extent is None else extent.grown_to(x, y)
        extent = extent or Extent(-1.0, -1.0, 1.0, 1.0)
        self.extent = Extent(extent.x0 - _MARGIN_M, extent.y0 - _MARGIN_M, extent.x1 + _MARGIN_M, extent.y1 + _MARGIN_M)
        # Signs keep a readable share of the picture on a small greenhouse and on a large one.
        self.sign = max(9.0, self.width * 0.0125, self.height * 0.0125)

    @property
    def width(self) -> float:
        """Centimetres."""
        return self.extent.width * 100.0

    @property
    def height(self) -> float:
        """Centimetres."""
        return self.extent.height * 100.0

    def at(self, x: float, y: float) -> tuple[float, float]:
        """A point of the map on the canvas."""
        return (x - self.extent.x0) * 100.0, (self.extent.y1 - y) * 100.0

    def picture(self, uri: str, extent: Extent, css: str) -> str:
        """A raster layer, its cells kept sharp."""
        left, top = self.at(extent.x0, extent.y1)
        size = {"width": extent.width * 100.0, "height": extent.height * 100.0}
        return tag("image", x=left, y=top, **size, href=uri, class_=css, preserveAspectRatio="none")


def _points(material: Material) -> Iterable[tuple[float, float]]:
    path = material.log.trajectory
    if len(path):
        yield from ((float(path.x.min()), float(path.y.min())), (float(path.x.max()), float(path.y.max())))
    for item in material.tags:
        if item.pose is not None:
            yield item.pose.x, item.pose.y
        yield from item.footprint


def map_svg(material: Material, canvas: Canvas, heat: Sequence[HeatMap]) -> str:
    """The whole drawing with all its layers, later ones on top."""
    layers = [
        _grid_layer(material, canvas),
        *(canvas.picture(data_uri(h.png, "png"), h.extent, f"heat heat-{h.sensor}") for h in heat),
        tag("g", *_truth(material, canvas), class_="layer truth"),
        tag("g", *_boxes(material.tags, canvas), class_="layer boxes"),
        tag("g", *_path(material, canvas), class_="layer path"),
        tag("g", *_flowers(material.tags, canvas), class_="layer flowers"),
        tag("path", id="scan", class_="scan", d="M0 0"),
        _robot(material, canvas),
        tag("g", *_ends(material, canvas), class_="layer ends"),
        tag("g", *_tags(material, canvas), class_="layer tags"),
        _scale_bar(canvas),
    ]
    found = len([item for item in material.tags if item.pose])
    label = f"Map, {canvas.extent.width:.1f} by {canvas.extent.height:.1f} metres, with the path driven and {found} tags"
    return tag(
        "svg",
        *layers,
        id="map",
        viewBox=f"0 0 {canvas.width:.0f} {canvas.height:.0f}",
        style=f"--sign:{canvas.sign:.1f}px;aspect-ratio:{canvas.width:.0f}/{canvas.height:.0f}",
        role="img",
        aria_label=label,
    )


def _grid_layer(material: Material, canvas: Canvas) -> str:
    grid = material.log.map
    extent = known_extent(grid) if grid is not None else None
    if grid is None or extent is None:
        return ""
    return "".join(
        canvas.picture(data_uri(map_png(grid, extent, theme), "png"), extent, f"grid {theme}") for theme in ("light", "dark")
    )


def _path(material: Material, canvas: Canvas) -> Iterable[str]:
    """The path in pieces, each with its colour by time and by speed; a halo under it keeps it readable on walls."""
    path = material.log.trajectory
    if len(path) < 2:
        return
    keep = thin(path.t_s, _PATH_PERIOD_S)
    points = [canvas.at(float(path.x[i]), float(path.y[i])) for i in keep]
    speed = speeds(path)[keep]
    fastest = max(float(np.percentile(speed, 98)), 1e-6)
    yield tag("path", d=path_data(points), class_="halo")
    step = max(1, math.ceil(len(points) / _SEGMENTS))
    for first in range(0, len(points) - 1, step):
        piece = points[first : first + step + 1]
        by_time = ramp(TIME_RAMP, first / (len(points) - 1))
        by_speed = ramp(SPEED_RAMP, float(speed[first : first + step + 1].mean()) / fastest)
        yield tag("path", d=path_data(piece), class_="leg", style=f"--time:{by_time};--speed:{by_speed}")
    for step_ in path.corrections:
        place = path.at(step_.t_s)
        if step_.distance_m >= 0.05 and place is not None:
            x, y = canvas.at(place.x, place.y)
            words = f"{clock(step_.t_s)}: the map corrected the robot's place by {step_.distance_m * 100:.0f} cm"
            yield tag("path", tag("title", esc(words)), d=_diamond(x, y, canvas.sign * 0.55), class_="correction")


def fastest_speed(material: Material) -> float:
    """The upper end of the speed colours, m/s."""
    path = material.log.trajectory
    return float(np.percentile(speeds(path), 98)) if len(path) > 1 else 0.0


def _boxes(tags: Sequence[TagResult], canvas: Canvas) -> Iterable[str]:
    for item in tags:
        if item.footprint:
            points = " ".join(f"{x:.1f},{y:.1f}" for x, y in (canvas.at(*point) for point in item.footprint))
            yield tag("polygon", tag("title", esc(f"Flower box of tag {item.tag_id}")), points=points)


def _flowers(tags: Sequence[TagResult], canvas: Canvas) -> Iterable[str]:
    radius = canvas.sign * 0.42
    for item in tags:
        for bloom in item.flower.blooms if item.flower else ():
            x, y = canvas.at(bloom.x, bloom.y)
            words = f"{species_label(bloom.species)} at tag {item.tag_id}, {bloom.confidence:.0%} sure"
            title = tag("title", esc(words + (", bug" if bloom.anomaly else "")))
            fill = SPECIES.get(bloom.species, SPECIES_OTHER)
            yield tag("circle", title, cx=x, cy=y, r=radius, fill=fill, class_="flower")
            if bloom.anomaly:
                yield tag("path", d=_bug(x + radius, y - radius, radius), class_="bug")


def _bug(x: float, y: float, size: float) -> str:
    """A body with three pairs of legs, as strokes."""
    legs = "".join(
        f"M{x - size:.1f} {y + k * size * 0.6:.1f}L{x + size:.1f} {y + k * size * 0.6:.1f}" for k in (-0.7, 0.0, 0.7)
    )
    return f"{legs}M{x:.1f} {y - size:.1f}L{x:.1f} {y + size:.1f}"


def _tags(material: Material, canvas: Canvas) -> Iterable[str]:
    placed = [item for item in material.tags if item.pose is not None]
    for item, (label_x, label_y) in zip(placed, _label_places(placed, canvas)):
        assert item.pose is not None
        x, y = canvas.at(item.pose.x, item.pose.y)
        words = f"Tag {item.tag_id}: {OUTCOME_WORDS[item.outcome]}"
        if item.readings:
            words += f", {item.health.replace('_', ' ')}"
        parts = [tag("title", esc(words)), tag("line", x1=x, y1=y, x2=label_x, y2=label_y, class_="leader")]
        parts.append(_plate(x, y, item.pose.facing_rad, canvas.sign))
        parts.append(tag("circle", cx=label_x, cy=label_y, r=canvas.sign * 0.95, class_=f"pin health-{item.health}"))
        parts.append(tag("text", esc(item.tag_id), x=label_x, y=label_y, class_="pin-text"))
        if item.outcome != READ:
            parts.append(tag("path", d=_cross(label_x + canvas.sign * 0.8, label_y - canvas.sign * 0.8, canvas.sign * 0.35)))
        css = f"tag outcome-{item.outcome}"
        yield tag("a", *parts, href=f"#tag-{anchor(item.tag_id)}", class_=css, data_tag=item.tag_id)


def _plate(x: float, y: float, facing_rad: float | None, sign: float) -> str:
    """The tag's plate seen from above, with a nose where its face looks."""
    if facing_rad is None:
        return tag("circle", cx=x, cy=y, r=sign * 0.4, class_="plate")
    nx, ny = math.cos(facing_rad), -math.sin(facing_rad)
    lx, ly = -ny * sign * 0.75, nx * sign * 0.75
    points = [(x - lx, y - ly), (x + nx * sign * 0.8, y + ny * sign * 0.8), (x + lx, y + ly)]
    return tag("path", d=path_data(points) + "Z", class_="plate")


def _label_places(tags: Sequence[TagResult], canvas: Canvas) -> list[tuple[float, float]]:
    """Where the id of each tag goes: out from its face, pushed apart until no two cover each other."""
    if not tags:
        return []
    places = np.array([canvas.at(t.pose.x, t.pose.y) for t in tags if t.pose is not None], dtype=float)
    for row, item in zip(places, tags):
        facing = item.pose.facing_rad if item.pose is not None else None
        if facing is not None:
            row += np.array([math.cos(facing), -math.sin(facing)]) * canvas.sign * 2.1
    apart = canvas.sign * 2.1
    for _ in range(40):
        delta = places[:, None] - places[None, :]
        distance = np.hypot(delta[..., 0], delta[..., 1])
        np.fill_diagonal(distance, np.inf)
        close = distance < apart
        if not close.any():
            break
        # Two labels in one place have no direction to part in: a fixed one by their order.
        angle = np.arange(len(places))[:, None] * 2.4
        direction = np.where(
            (distance < 1e-6)[..., None],
            np.dstack([np.cos(angle), np.sin(angle)]),
            delta / np.maximum(distance, 1e-6)[..., None],
        )
        push = np.where(close, (apart - np.minimum(distance, apart)) / 2.0 + 0.1, 0.0)[..., None] * direction
        places += push.sum(axis=1)
    inset = canvas.sign
    places[:, 0] = places[:, 0].clip(inset, canvas.width - inset)
    places[:, 1] = places[:, 1].clip(inset, canvas.height - inset)
    return [(float(x), float(y)) for x, y in places]


def _ends(material: Material, canvas: Canvas) -> Iterable[str]:
    path = material.log.trajectory
    if not len(path):
        return
    begin_s, end_s = material.mission_span_s
    for css, t_s, letter, words in (("start", begin_s, "S", "Start"), ("end", end_s, "E", "End")):
        place = path.at(t_s) or Pose2(*(float(column[0 if css == "start" else -1]) for column in (path.x, path.y, path.yaw)))
        x, y = canvas.at(place.x, place.y)
        # Home is both, and the robot stands there: the signs go to either side.
        x += (canvas.sign + _ROBOT_LENGTH_M * 50.0) * (-1.0 if css == "start" else 1.0)
        s = canvas.sign * 0.8
        parts = [
            tag("title", esc(f"{words} of the mission, {clock(t_s)}")),
            tag("rect", x=x - s, y=y - s, width=2 * s, height=2 * s, rx=s * 0.4),
        ]
        yield tag("g", *parts, tag("text", letter, x=x, y=y), class_=f"end {css}")


def _truth(material: Material, canvas: Canvas) -> Iterable[str]:
    """What really stands there, as outlines, with the path that was really driven."""
    truth, frame = material.truth, material.map_from_world
    for item in [*(truth.get("walls") or ()), *(truth.get("boxes") or ())]:
        pose = frame @ Pose2(float(item["x"]), float(item["y"]), float(item["yaw"]))
        depth, width = float(item["depth"]) / 2.0, float(item["width"]) / 2.0
        corners = (pose.apply(a * depth, b * width) for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1)))
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in (canvas.at(*corner) for corner in corners))
        yield tag("polygon", points=points)
    for item in truth.get("pillars") or ():
        x, y = canvas.at(*frame.apply(float(item["x"]), float(item["y"])))
        yield tag("circle", cx=x, cy=y, r=float(item["radius"]) * 100.0)
    if len(material.true_path) > 1:
        step = max(1, len(material.true_path) // 3000)
        yield tag("path", d=path_data(canvas.at(*point) for point in material.true_path[::step]), class_="true-path")
    for item in truth.get("tags") or ():
        x, y = canvas.at(*frame.apply(float(item["x"]), float(item["y"])))
        title = tag("title", esc(f"True place of tag {item['id']}"))
        yield tag("path", title, d=_cross(x, y, canvas.sign * 0.5), class_="true-tag")


def _robot(material: Material, canvas: Canvas) -> str:
    """The robot at the end of the path; the time slider moves it."""
    path = material.log.trajectory
    if not len(path):
        return ""
    x, y = canvas.at(float(path.x[-1]), float(path.y[-1]))
    half_length, half_width = _ROBOT_LENGTH_M * 50.0, _ROBOT_WIDTH_M * 50.0
    body = tag("rect", x=-half_length, y=-half_width, width=2 * half_length, height=2 * half_width, rx=5)
    back, side = half_length * 0.15, half_width * 0.5
    nose = tag("path", d=path_data([(back, -side), (half_length * 0.8, 0.0), (back, side)]) + "Z")
    turn = -math.degrees(float(path.yaw[-1]))
    return tag("g", body, nose, id="robot", class_="robot", transform=f"translate({x:.1f} {y:.1f}) rotate({turn:.1f})")


def _scale_bar(canvas: Canvas) -> str:
    length = next((m for m in (1.0, 2.0, 5.0) if m * 100.0 >= canvas.width * 0.08), 10.0)
    x, y = canvas.sign, canvas.height - canvas.sign
    bar = tag("path", d=f"M{x:.1f} {y - 4:.1f}v8M{x:.1f} {y:.1f}h{length * 100:.0f}m0 -4v8")
    return tag("g", bar, tag("text", f"{length:.0f} m", x=x + length * 100 + canvas.sign * 0.6, y=y), class_="scale")


def _diamond(x: float, y: float, size: float) -> str:
    return f"M{x:.1f} {y - size:.1f}L{x + size:.1f} {y:.1f}L{x:.1f} {y + size:.1f}L{x - size:.1f} {y:.1f}Z"


def _cross(x: float, y: float, size: float) -> str:
    return f"M{x - size:.1f} {y - size:.1f}l{2 * size:.1f} {2 * size:.1f}m0 {-2 * size:.1f}l{-2 * size:.1f} {2 * size:.1f}"


def anchor(tag_id: str) -> str:
    """A tag's id as part of a fragment: letters and digits stay, the rest is written as its code points."""
    return "".join(c if c.isalnum() and c.isascii() else f"-{ord(c):x}" for c in tag_id)
