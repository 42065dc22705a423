"""Trajectories for the vendor's arm controller, which takes no partial goals: all four joints, always."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from lupin_runtime.arm.limits import Arm

SHORTEST_S = 0.1
SLOWEST, FASTEST = 0.25, 2.0
# Rad/s on every joint of every point. Zero is said to be rejected by the vendor's hardware interface.
VELOCITY_HINT = 1.0


class Point(NamedTuple):
    """Where the arm is to be, `t_s` after the start."""

    t_s: float
    arm: Arm


def to_pose(arm: Arm, duration_s: float) -> tuple[Point, ...]:
    """One point, no sooner than SHORTEST_S."""
    return (Point(max(SHORTEST_S, duration_s), arm),)


def clamp_speed(speed: float) -> float:
    """A factor on the speed of a replay; 0 (and what is not a number) means as recorded."""
    if not math.isfinite(speed) or speed == 0.0:
        return 1.0
    return min(FASTEST, max(SLOWEST, speed))


def timed(points: Sequence[Point], speed: float = 1.0, lead_in_s: float = 0.0) -> tuple[Point, ...]:
    """A recorded motion at a factor of its speed, after `lead_in_s` for getting to its first point.

    Times come out strictly increasing, as the controller demands: a point that would not come after the one before it by a
    millisecond is dropped, unless it is the last, which replaces that one. Raises ValueError for no points.
    """
    if not points:
        raise ValueError("expected at least one way point, found none")
    speed = clamp_speed(speed)
    out: list[Point] = []
    for point in points:
        t_s = max(SHORTEST_S, lead_in_s + (point.t_s - points[0].t_s) / speed)
        if not out or t_s >= out[-1].t_s + 1e-3:
            out.append(Point(t_s, point.arm))
        elif point is points[-1]:
            out[-1] = Point(out[-1].t_s, point.arm)
    return tuple(out)
