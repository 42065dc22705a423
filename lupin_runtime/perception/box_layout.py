"""The boxes of a known layout, registered in the map by the discovered tags, since a layout has its own origin."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from lupin_runtime.geometry import Pose2
from lupin_runtime.layout import Layout, Table
from lupin_runtime.perception.box_geometry import BoxSize, Point2, rigid_fit

# A layout is accurate to a decimeter; a tag further off is another one, or hangs elsewhere.
MAX_RESIDUAL_M = 0.35
MIN_BASELINE_M = 0.5  # between two tags: nearer ones do not determine a rotation


@dataclass(frozen=True)
class LayoutBox:
    """The box behind one tag in the layout's frame: `center` faces out of the side on which the tag hangs, at `tag`."""

    center: Pose2
    size: BoxSize
    tag: Point2


def boxes_of(layout: Layout, height_m: float) -> dict[str, LayoutBox]:
    """Map tag ids to boxes: the nearest table, turned so that the side nearest to the tag is its front. None without tables."""
    boxes = {}
    for tag_id, place in layout.tags.items():
        if layout.tables:
            table = min(layout.tables.values(), key=lambda t: _distance(t, place.x, place.y))
            boxes[tag_id] = _facing(table, place.x, place.y, height_m)
    return boxes


def _distance(table: Table, x: float, y: float) -> float:
    return math.hypot(max(table.x0 - x, 0.0, x - table.x1), max(table.y0 - y, 0.0, y - table.y1))


def _facing(table: Table, x: float, y: float, height_m: float) -> LayoutBox:
    along_x, along_y = table.x1 - table.x0, table.y1 - table.y0
    clamped_x, clamped_y = min(max(x, table.x0), table.x1), min(max(y, table.y0), table.y1)
    # For each side: the tag's distance, the heading out of it, its width, the box's depth behind it, the tag's position on it.
    sides = (
        (abs(y - table.y0), -math.pi / 2, along_x, along_y, (clamped_x, table.y0)),
        (abs(y - table.y1), math.pi / 2, along_x, along_y, (clamped_x, table.y1)),
        (abs(x - table.x0), math.pi, along_y, along_x, (table.x0, clamped_y)),
        (abs(x - table.x1), 0.0, along_y, along_x, (table.x1, clamped_y)),
    )
    _, yaw, width, depth, tag = min(sides, key=lambda side: side[0])
    return LayoutBox(Pose2(*table.center, yaw), BoxSize(width, depth, height_m), tag)


def register(boxes: Mapping[str, LayoutBox], found: Mapping[str, Point2]) -> Pose2 | None:
    """Compute map_from_layout from the tags of both; None if fewer than two agree, or they are too close together.

    The tag that fits worst is dropped until all fit.
    """
    common = [tag_id for tag_id in boxes if tag_id in found]
    while len(common) >= 2:
        source, target = [boxes[t].tag for t in common], [found[t] for t in common]
        if max(math.dist(a, b) for a in source for b in source) < MIN_BASELINE_M:
            return None
        motion = rigid_fit(source, target)
        residuals = [math.dist(motion.apply(*a), b) for a, b in zip(source, target)]
        worst = max(range(len(common)), key=residuals.__getitem__)
        if residuals[worst] <= MAX_RESIDUAL_M:
            return motion
        del common[worst]
    return None


def registered(boxes: Mapping[str, LayoutBox], map_from_layout: Pose2) -> list[dict[str, Any]]:
    """The boxes as entries of `/perception/box_geometry_json`, in the map."""
    entries = []
    for tag_id, box in boxes.items():
        center = map_from_layout @ box.center
        size = {"width": box.size.width, "depth": box.size.depth, "height": box.size.height}
        entries.append({"id": tag_id, "x": center.x, "y": center.y, "yaw": center.yaw, **size})
    return entries
