"""Limits how fast a command may grow, so that no gap in the stream of commands ends in a step of the velocity.

Only growth is limited: a command that slows down or stops passes at once.
"""

from __future__ import annotations

import math

from lupin_runtime.drive.twist import Twist

# Above navigation's own limits (2.5 m/s², 3.2 rad/s²), so that a smooth stream passes unchanged.
LINEAR_MPS2 = 3.0
YAW_RADPS2 = 6.0
# Streams jitter: a command may be this much ahead of the ramp. From rest it is also the first step: 0.15 m/s, 0.3 rad/s.
SLACK_S = 0.05
# The time between two commands counts up to this much.
LONGEST_GAP_S = 0.1

_RATES = (LINEAR_MPS2, LINEAR_MPS2, YAW_RADPS2)


class Ramp:
    """Follows the stream of commands to the sink. Times are nanoseconds of one clock."""

    def __init__(self) -> None:
        self._reached = [0.0, 0.0, 0.0]  # the ramp of each axis: x and y in m/s, yaw in rad/s
        self._commanded_ns: int | None = None

    def stop(self) -> None:
        """The sink was sent zero: the next command starts from rest."""
        self._reached = [0.0, 0.0, 0.0]
        self._commanded_ns = None

    def limit(self, twist: Twist, now_ns: int) -> Twist:
        """`twist`, each axis no faster than the ramp allows; `twist` itself where nothing is limited."""
        gap_s = 0.0 if self._commanded_ns is None else (now_ns - self._commanded_ns) / 1e9
        gap_s = min(LONGEST_GAP_S, max(0.0, gap_s))
        self._commanded_ns = now_ns
        limited = list(twist)
        for axis, (target, rate) in enumerate(zip(twist, _RATES)):
            reached = self._reached[axis]
            speed = abs(reached) if reached * target > 0.0 else 0.0  # a reversal starts from rest
            speed = min(abs(target), speed + rate * gap_s)
            self._reached[axis] = math.copysign(speed, target)
            limited[axis] = math.copysign(min(abs(target), speed + rate * SLACK_S), target)
        out = Twist(*limited)
        return twist if out == twist else out
