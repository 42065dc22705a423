"""From sticks to a velocity: dead zones, a curve that is fine around the center, and the speeds."""

from __future__ import annotations

import math
from dataclasses import dataclass

from lupin_runtime.drive import ZERO, Twist

# Share of the cubic part: half of the way of a stick then commands about a third of its speed.
EXPO = 0.5


@dataclass(frozen=True)
class Speeds:
    """The velocity of a stick pushed all the way."""

    linear_mps: float
    yaw_radps: float


NORMAL = Speeds(0.2, 0.7)
TURBO = Speeds(0.6, 1.4)


@dataclass(frozen=True)
class Sticks:
    """The sticks of a pad, -1..1: the left one forward and to the left, the right one to the left."""

    forward: float = 0.0
    left: float = 0.0
    turn_left: float = 0.0


def normalize(value: int | None, low: int, high: int, unknown: float = 0.0) -> float:
    """Return the place of a stick in its range as -1..1; `unknown` without a value or a range, or far outside of it.

    A value slightly outside is the end of the way: the kernel does not limit what a pad sends.
    """
    if value is None or high <= low:
        return unknown
    place = (2 * value - low - high) / (high - low)
    return max(-1.0, min(1.0, place)) if abs(place) <= 1.2 else unknown


def shape(deflection: float, dead_zone: float) -> float:
    """Return the share of the full speed for a deflection of 0..1: 0 in the dead zone, and 1 at the end of the way."""
    if deflection <= dead_zone:
        return 0.0
    travel = min(1.0, (deflection - dead_zone) / (1.0 - dead_zone))
    return (1.0 - EXPO) * travel + EXPO * travel**3


def command_velocity(sticks: Sticks, *, turbo: bool, dead_zone: float) -> Twist:
    """Return the velocity that the sticks command. The left stick's dead zone is a circle, and its direction is kept."""
    speeds = TURBO if turbo else NORMAL
    deflection = math.hypot(sticks.forward, sticks.left)
    speed = speeds.linear_mps * shape(deflection, dead_zone)
    yaw = math.copysign(speeds.yaw_radps * shape(abs(sticks.turn_left), dead_zone), sticks.turn_left)
    if speed == 0.0:
        return Twist(0.0, 0.0, yaw) if yaw else ZERO
    return Twist(speed * sticks.forward / deflection, speed * sticks.left / deflection, yaw)
