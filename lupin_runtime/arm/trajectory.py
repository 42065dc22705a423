"""Trajectories for the vendor's arm controller, which accepts only goals for all four joints."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from lupin_runtime.arm.limits import Arm

MIN_DURATION_S = 0.1
MIN_SPEED, MAX_SPEED = 0.25, 2.0
# Rad/s for every joint of every point: the vendor's hardware interface is reported to reject zero.
VELOCITY_HINT = 1.0


class Point(NamedTuple):
    """The arm's target at `t_s` seconds after the start."""

    t_s: float
    arm: Arm


def to_pose(arm: Arm, duration_s: float) -> tuple[Point, ...]:
    """Return a path of one point, at least MIN_DURATION_S after the start."""
    return (Point(max(MIN_DURATION_S, duration_s), arm),)


def clamp_speed(speed: float) -> float:
    """Return the speed factor of a replay within its limits; 0 and non-finite values mean the recorded speed."""
    if not math.isfinite(speed) or speed == 0.0:
        return 1.0
    return min(MAX_SPEED, max(MIN_SPEED, speed))


def retime(points: Sequence[Point], speed: float = 1.0, lead_in_s: float = 0.0) -> tuple[Point, ...]:
    """Return a recorded motion at `speed` times its speed, preceded by `lead_in_s` for the move to its first point.

    Times strictly increase, as the controller requires: a point less than a millisecond after the previous one is dropped; the
    last point instead replaces the previous one. Raises ValueError for no points.
    """
    if not points:
        raise ValueError("expected at least one waypoint, found none")
    speed = clamp_speed(speed)
    out: list[Point] = []
    for point in points:
        t_s = max(MIN_DURATION_S, lead_in_s + (point.t_s - points[0].t_s) / speed)
        if not out or t_s >= out[-1].t_s + 1e-3:
            out.append(Point(t_s, point.arm))
        elif point is points[-1]:
            out[-1] = Point(out[-1].t_s, point.arm)
    return tuple(out)
