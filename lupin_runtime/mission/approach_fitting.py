"""Moves an approach to the nearest pose that has enough room on the map and still faces the tag."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from lupin_runtime.geometry import wrap_angle
from lupin_runtime.mission.approach import Approach
from lupin_runtime.mission.clearance import ClearanceMap

# Turning around the tag costs viewing angle, stepping back costs resolution: a tag is readable within 60 degrees and 2 m.
_TURNS_RAD = tuple(math.radians(degrees) for degrees in (0, 15, -15, 30, -30, 45, -45))
_ALL_SIDES_RAD = tuple(wrap_angle(math.radians(30 * k)) for k in range(12))
_STEP_M, _MAX_DISTANCE_M = 0.05, 0.8
_TURN_COST_M = 0.4  # a turn of one radian costs as much as this change of the standoff
_TAG_MARGIN_M = 0.15  # the line of sight is not checked this close to the tag: the tag hangs on something occupied
_UNREACHABLE_RADIUS_M = 0.1


def fit_approach(
    approach: Approach,
    tag_xy: tuple[float, float],
    clearance: ClearanceMap,
    room_m: float,
    unreachable: Sequence[tuple[float, float]] = (),
) -> Approach:
    """Return the approach if the map is free for `room_m` around it, else the nearest pose with this room.

    Candidates are turns around the tag up to 45 degrees (all sides for a fallback approach) and standoffs from 0.3 m to
    0.8 m or the nominal one, whichever is greater. Poses within 0.1 m of a point in `unreachable`, which the robot could
    not reach before, are excluded. If the approach is moved, `derived_from` says so after a plus sign. An operator's
    override is never moved. If nothing fits, the approach is returned unchanged.
    """
    if approach.derived_from == "override":
        return approach
    if approach.derived_from == "fallback":  # the goal is the tag's own position: approach it from any side
        turns, normal, nominal = _ALL_SIDES_RAD, approach.goal_yaw + math.pi, 0.5
    else:
        turns = _TURNS_RAD
        normal, nominal = math.atan2(approach.goal_y - tag_xy[1], approach.goal_x - tag_xy[0]), approach.standoff_m
    max_distance = max(nominal, _MAX_DISTANCE_M)
    standoffs = [nominal + k * _STEP_M for k in range(-20, 31) if 0.3 <= nominal + k * _STEP_M <= max_distance + 1e-9]
    candidates = sorted(
        ((turn, standoff) for turn in turns for standoff in {nominal, *standoffs}),
        key=lambda c: (_TURN_COST_M * abs(c[0]) + abs(c[1] - nominal), abs(c[0]), c[1]),
    )
    for turn, standoff in candidates:
        x = tag_xy[0] + standoff * math.cos(normal + turn)
        y = tag_xy[1] + standoff * math.sin(normal + turn)
        if any(math.hypot(x - bx, y - by) < _UNREACHABLE_RADIUS_M for bx, by in unreachable):
            continue
        if clearance.distance_at(x, y) < room_m or not clearance.has_line_of_sight(x, y, *tag_xy, _TAG_MARGIN_M):
            continue
        if turn == 0.0 and standoff == nominal and approach.derived_from != "fallback":
            return approach
        return replace(
            approach,
            goal_x=x,
            goal_y=y,
            goal_yaw=math.atan2(tag_xy[1] - y, tag_xy[0] - x),
            standoff_m=standoff,
            derived_from=f"{approach.derived_from}+{standoff:.2f}m{math.degrees(turn):+.0f}deg",
        )
    return approach
