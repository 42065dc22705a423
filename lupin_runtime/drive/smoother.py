"""Limits velocity and acceleration of navigation's commands, open loop: it uses its last output, not the base's motion.

Acceleration and deceleration are limited per axis. A velocity that changes sign first slows down to zero and then speeds up,
both in one step if time is left. Without a command for `timeout_s`, and after a non-finite one, the target is zero. At rest
it outputs zero REST_REPEATS times and then nothing, so that it does not win the drive bus.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from lupin_runtime.drive.twist import ZERO, Twist

REST_REPEATS = 5


@dataclass(frozen=True)
class AxisLimits:
    """Limits of one axis in m/s and m/s², or rad/s and rad/s². `slowest` is at most zero, `decel` is negative."""

    fastest: float
    slowest: float
    accel: float
    decel: float

    def __post_init__(self) -> None:
        if not (self.fastest >= 0.0 >= self.slowest and self.accel > 0.0 > self.decel):
            raise ValueError(f"expected fastest >= 0 >= slowest and accel > 0 > decel, found {self}")

    def step(self, velocity: float, target: float, dt_s: float) -> float:
        """Return the velocity that follows `velocity` after `dt_s` on the way to `target`."""
        target = min(self.fastest, max(self.slowest, target))
        if velocity * target < 0.0:
            to_rest_s = abs(velocity) / -self.decel
            if to_rest_s >= dt_s:
                return velocity - math.copysign(self.decel * dt_s, velocity)
            return self.step(0.0, target, dt_s - to_rest_s)
        rate = self.accel if abs(target) > abs(velocity) else -self.decel
        change = target - velocity
        return target if abs(change) <= rate * dt_s else velocity + math.copysign(rate * dt_s, change)


class Smoother:
    """Smooths the three axes. Times are nanoseconds of one clock."""

    def __init__(self, x: AxisLimits, y: AxisLimits, yaw: AxisLimits, timeout_s: float = 1.0, deadband: Twist = ZERO) -> None:
        self._axes = (x, y, yaw)
        self._timeout_ns = int(timeout_s * 1e9)
        self._deadband = deadband
        self._target = ZERO
        self._received_ns: int | None = None
        self._velocity = ZERO
        self._rests_sent = REST_REPEATS
        self.rejected = 0

    def command(self, twist: Twist | None, now_ns: int) -> None:
        """Handle a command; None stands for a malformed or non-finite one and sets the target to zero."""
        if twist is None or not twist.is_finite():
            self.rejected += 1
            twist = ZERO
        self._target = Twist(*(0.0 if abs(v) < band else v for v, band in zip(twist, self._deadband)))
        self._received_ns = now_ns

    def tick(self, now_ns: int, dt_s: float) -> Twist | None:
        """Return the velocity to publish now, `dt_s` after the last call; None after the repeated zeros at rest."""
        if self._received_ns is None or not 0 <= now_ns - self._received_ns <= self._timeout_ns:
            self._target = ZERO
        axes = zip(self._axes, self._velocity, self._target)
        self._velocity = Twist(*(limits.step(velocity, target, dt_s) for limits, velocity, target in axes))
        if self._velocity != ZERO:
            self._rests_sent = 0
            return self._velocity
        if self._rests_sent >= REST_REPEATS:
            return None
        self._rests_sent += 1
        return ZERO
