"""Four mecanum wheels: kinematics between body twist and wheel speeds, and models of the motors.

Twists are (vx, vy, wz) in m/s and rad/s of `base_link`; wheel speeds are rad/s in the vendor's order: front left, rear left,
rear right, front right.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lupin_sim import mirte

Array = NDArray[np.float64]

_L = mirte.WHEEL_LEVER_M
# Rollers at 45 degrees, X pattern (Taheri et al., "Kinematic Model of a Four Mecanum Wheeled Mobile Robot", 2015).
_WHEELS_FROM_TWIST = np.array([[1, -1, -_L], [1, 1, -_L], [1, -1, _L], [1, 1, _L]], float) / mirte.WHEEL_RADIUS_M
_TWIST_FROM_WHEELS = np.linalg.pinv(_WHEELS_FROM_TWIST)


def wheels_from_twist(twist: Array) -> Array:
    """Return the wheel speeds, shape (4,), for a twist of shape (3,), without limits."""
    return _WHEELS_FROM_TWIST @ twist


def twist_from_wheels(speeds: Array) -> Array:
    """Return the body twist, shape (3,), that fits four wheel speeds best (least squares)."""
    return _TWIST_FROM_WHEELS @ speeds


def clamp_wheels(speeds: Array) -> Array:
    """Limit each wheel speed separately, as the vendor's controller does; so a twist beyond the limit changes its direction."""
    return np.clip(speeds, -mirte.WHEEL_MAX_RADPS, mirte.WHEEL_MAX_RADPS)


class Drive(Protocol):
    """A model of motors and their controllers: how wheel speeds follow their setpoints."""

    speeds: Array

    def step(self, target: Array, dt_s: float) -> Array:
        """Advance by `dt_s` towards the target speeds, shape (4,); returns the new speeds."""


def _apply_friction(speeds: Array, lag_s: float, dt_s: float) -> Array:
    """Reduce the speeds of stopping wheels by dry friction, since a first-order lag alone never reaches zero.

    The dead zone gives its amount: a tenth of full drive overcomes it.
    """
    loss = mirte.WHEEL_DEAD_ZONE * mirte.WHEEL_MAX_RADPS * -math.expm1(-dt_s / lag_s)
    return np.copysign(np.maximum(np.abs(speeds) - loss, 0.0), speeds)


class IdealDrive:
    """A short first-order lag with limited acceleration; dry friction at the end of a stop."""

    LAG_S = 0.05
    MAX_RADPS2 = 80.0  # 4 m/s^2 at the rim

    def __init__(self) -> None:
        self.speeds: Array = np.zeros(4)

    def step(self, target: Array, dt_s: float) -> Array:
        """See Drive."""
        wanted = self.speeds + (clamp_wheels(target) - self.speeds) * -math.expm1(-dt_s / self.LAG_S)
        wanted = np.where(target == 0.0, _apply_friction(wanted, self.LAG_S, dt_s), wanted)
        limit = self.MAX_RADPS2 * dt_s
        self.speeds = self.speeds + np.clip(wanted - self.speeds, -limit, limit)
        return self.speeds


class VendorDrive:
    """The vendor's wheel control: 10 Hz PID without feedforward, output in integer percent, dead zone 10 %, motor lag 0.1 s.

    Inferred from the vendor's configuration, not measured on a robot.
    """

    PERIOD_S = 0.1
    GAINS = (1.5, 0.5, 0.01)  # proportional, integral, derivative
    INTEGRAL_LIMIT = 15.0
    LAG_S = 0.1

    def __init__(self) -> None:
        self.speeds: Array = np.zeros(4)
        self._integral: Array = np.zeros(4)
        self._last_error: Array = np.zeros(4)
        self._percent: Array = np.zeros(4)
        self._until_tick_s = 0.0

    def step(self, target: Array, dt_s: float) -> Array:
        """See Drive."""
        self._until_tick_s -= dt_s
        if self._until_tick_s <= 1e-9:
            self._until_tick_s += self.PERIOD_S
            self._tick(clamp_wheels(target))
        driven = self._percent / 100.0 * mirte.WHEEL_MAX_RADPS
        self.speeds = self.speeds + (driven - self.speeds) * -math.expm1(-dt_s / self.LAG_S)
        self.speeds = np.where(target == 0.0, _apply_friction(self.speeds, self.LAG_S, dt_s), self.speeds)
        return self.speeds

    def _tick(self, target: Array) -> None:
        p, i, d = self.GAINS
        error = target - self.speeds
        self._integral = np.clip(self._integral + error * self.PERIOD_S * i, -self.INTEGRAL_LIMIT, self.INTEGRAL_LIMIT)
        output = p * error + self._integral + d * (error - self._last_error) / self.PERIOD_S
        self._last_error = error
        # Reset the integral at a stop, or the wheels would continue to creep.
        stopped = target == 0.0
        self._integral[stopped] = 0.0
        output[stopped] = 0.0
        percent = np.clip(np.trunc(output / mirte.WHEEL_MAX_RADPS * 100.0), -100.0, 100.0)
        percent[np.abs(percent) < mirte.WHEEL_DEAD_ZONE * 100.0] = 0.0
        self._percent = percent


DRIVES: dict[str, type[IdealDrive] | type[VendorDrive]] = {"ideal": IdealDrive, "vendor": VendorDrive}
