"""The pose in front of a tag from which the camera faces it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from lupin_runtime.layout import Layout, Table
from lupin_runtime.mission.overrides import Override
from lupin_runtime.mission.records import MapPose

MIN_STANDOFF_M, MAX_STANDOFF_M = 0.2, 1.5  # beyond 1.5 m a 100 mm tag is not detected reliably
_SHORTEN_STEP_M = 0.1


@dataclass(frozen=True)
class Approach:
    """A goal in front of a tag: meters and radians in the map frame. `derived_from` names the rule that produced it."""

    tag_id: str
    goal_x: float
    goal_y: float
    goal_yaw: float
    standoff_m: float
    derived_from: str
    table_id: str | None = None


def clamp_standoff(standoff_m: float) -> float:
    """Clip to [0.2, 1.5] m; a value that is not finite becomes 0.2 m."""
    return min(MAX_STANDOFF_M, max(MIN_STANDOFF_M, standoff_m)) if math.isfinite(standoff_m) else MIN_STANDOFF_M


def compute_approach(
    tag_id: str, layout: Layout, standoff_m: float, fallback_yaw: float, override: Override | None = None
) -> Approach:
    """Return the approach to a tag of the layout, on the line from its table's center through the tag.

    Raises KeyError for a tag that is not in the layout.
    """
    tag = layout.tags[tag_id]
    override = override or Override()
    full_override = _fully_overridden(tag_id, override, standoff_m)
    if full_override is not None:
        return full_override
    standoff = clamp_standoff(standoff_m if override.standoff is None else override.standoff)
    geometric = _approach_from_table(tag_id, (tag.x, tag.y), layout, standoff) or Approach(
        tag_id, tag.x, tag.y, fallback_yaw, 0.0, "fallback"
    )
    return _apply_override(geometric, override)


def compute_discovered_approach(
    tag_id: str,
    tag: MapPose,
    robot_xy: tuple[float, float] | None,
    standoff_m: float,
    fallback_yaw: float,
    override: Override | None = None,
) -> Approach:
    """Return the approach to a discovered tag: along its normal, else from the robot's side, else the tag's own position."""
    override = override or Override()
    full_override = _fully_overridden(tag_id, override, standoff_m)
    if full_override is not None:
        return full_override
    standoff = clamp_standoff(standoff_m if override.standoff is None else override.standoff)
    normal, source = tag.normal_xy(), "discovered_normal"
    if normal is None and robot_xy is not None:
        dx, dy = robot_xy[0] - tag.x, robot_xy[1] - tag.y
        distance = math.hypot(dx, dy)
        if distance >= 1e-6:
            normal, source = (dx / distance, dy / distance), "discovered_robot"
    if normal is None:
        geometric = Approach(tag_id, tag.x, tag.y, fallback_yaw, 0.0, "fallback")
    else:
        geometric = _in_front(tag_id, (tag.x, tag.y), normal, standoff, source)
    return _apply_override(geometric, override)


def _fully_overridden(tag_id: str, override: Override, standoff_m: float) -> Approach | None:
    if override.goal_x is None or override.goal_y is None or override.yaw is None:
        return None
    standoff = clamp_standoff(standoff_m if override.standoff is None else override.standoff)
    return Approach(tag_id, override.goal_x, override.goal_y, override.yaw, standoff, "override")


def _apply_override(approach: Approach, override: Override) -> Approach:
    changes: dict[str, float] = {}
    if override.goal_x is not None:
        changes["goal_x"] = override.goal_x
    if override.goal_y is not None:
        changes["goal_y"] = override.goal_y
    if override.yaw is not None:
        changes["goal_yaw"] = override.yaw
    if override.standoff is not None:
        changes["standoff_m"] = clamp_standoff(override.standoff)
    return replace(approach, derived_from="override", **changes) if changes else approach  # type: ignore[arg-type]


def _in_front(tag_id: str, tag: tuple[float, float], normal: tuple[float, float], standoff_m: float, source: str) -> Approach:
    return Approach(
        tag_id,
        tag[0] + standoff_m * normal[0],
        tag[1] + standoff_m * normal[1],
        math.atan2(-normal[1], -normal[0]),
        standoff_m,
        source,
    )


def _approach_from_table(tag_id: str, tag: tuple[float, float], layout: Layout, standoff_m: float) -> Approach | None:
    if not layout.tables:
        return None
    table_id, table = min(
        layout.tables.items(),
        key=lambda item: (math.hypot(tag[0] - item[1].center[0], tag[1] - item[1].center[1]), item[0]),
    )
    dx, dy = tag[0] - table.center[0], tag[1] - table.center[1]
    distance = math.hypot(dx, dy)
    if distance < 1e-6:
        return None
    normal = (dx / distance, dy / distance)
    for standoff in _shorter_standoffs(standoff_m):
        approach = _in_front(tag_id, tag, normal, standoff, "geometry")
        if not _is_on_table(layout.tables, approach.goal_x, approach.goal_y):
            return replace(approach, table_id=table_id)
    return None


def _shorter_standoffs(standoff_m: float) -> Iterator[float]:
    """Yield the standoff, then shorter ones: the pose must not be inside a neighboring table."""
    steps = int((standoff_m - MIN_STANDOFF_M) / _SHORTEN_STEP_M + 1e-9)
    for step in range(steps + 1):
        yield standoff_m - step * _SHORTEN_STEP_M
    if standoff_m - steps * _SHORTEN_STEP_M > MIN_STANDOFF_M + 1e-9:
        yield MIN_STANDOFF_M


def _is_on_table(tables: Mapping[str, Table], x: float, y: float) -> bool:
    return any(table.contains(x, y) for table in tables.values())
