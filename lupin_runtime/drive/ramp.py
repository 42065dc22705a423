"""Limits how fast commands may speed up, so that the velocity does not jump when commands resume after a gap.

Only speeding up is limited: a command that slows the base down or stops it passes at once.
"""

from __future__ import annotations

import math

from lupin_runtime.drive.twist import Twist

# Above navigation's own limits (2.5 m/s², 3.2 rad/s²), so that a smooth stream passes unchanged.
LINEAR_MPS2 = 3.0
YAW_RADPS2 = 6.0
# A command may be this much ahead of the ramp, because commands do not arrive at regular intervals. From rest this allows a
# first step of 0.15 m/s and 0.3 rad/s.
SLACK_S = 0.05
# A longer time between two commands counts as this much, so that the ramp does not grow during a gap.
MAX_GAP_S = 0.1
# After a longer gap the ramp starts from rest: the base stops by itself when it has received no command for 0.25 s.
REST_GAP_S = 0.2

_RATES = (LINEAR_MPS2, LINEAR_MPS2, YAW_RADPS2)


class Ramp:
    """Limits the commands to the sink one after the other. Times are nanoseconds of one clock."""

    def __init__(self) -> None:
        self._reached = [0.0, 0.0, 0.0]  # the ramp of each axis: x and y in m/s, yaw in rad/s
        self._last_command_ns: int | None = None

    def reset(self) -> None:
        """Start from rest with the next command, because zero was sent to the sink."""
        self._reached = [0.0, 0.0, 0.0]
        self._last_command_ns = None

    def limit(self, twist: Twist, now_ns: int) -> Twist:
        """Limit each axis of `twist` to what the ramp allows; return `twist` itself if nothing is limited."""
        if self._last_command_ns is not None and not 0 <= now_ns - self._last_command_ns <= REST_GAP_S * 1e9:
            self.reset()
        gap_s = 0.0 if self._last_command_ns is None else (now_ns - self._last_command_ns) / 1e9
        gap_s = min(MAX_GAP_S, max(0.0, gap_s))
        self._last_command_ns = now_ns
        limited = list(twist)
        for axis, (target, rate) in enumerate(zip(twist, _RATES)):
            reached = self._reached[axis]
            speed = abs(reached) if reached * target > 0.0 else 0.0  # a reversal starts from rest
            speed = min(abs(target), speed + rate * gap_s)
            self._reached[axis] = math.copysign(speed, target)
            limited[axis] = math.copysign(min(abs(target), speed + rate * SLACK_S), target)
        out = Twist(*limited)
        return twist if out == twist else out
