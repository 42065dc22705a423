"""Wheel odometry: integrates the wheel speeds, so it drifts, and it continues while the robot is blocked."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2
from lupin_sim.wheels import twist_from_wheels

# Standard deviations, from runs of a mecanum model with real rollers: 0.4-2.4 % of the path, 0.1-0.5 % of the turning.
LINEAR_SCALE_ERROR = 0.008
ANGULAR_SCALE_ERROR = 0.003
# Slip is a random walk whose variance grows with the distance driven.
SLIP_M_PER_SQRT_M = 0.004
SLIP_RAD_PER_SQRT_M = 0.004
SLIP_RAD_PER_SQRT_RAD = 0.003


class WheelOdometry:
    """Pose and twist in the odom frame, whose origin is the start pose."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._scale = 1.0 + rng.normal(size=3) * (LINEAR_SCALE_ERROR, LINEAR_SCALE_ERROR, ANGULAR_SCALE_ERROR)
        self.pose = Pose2()
        self.twist = (0.0, 0.0, 0.0)

    def step(self, wheel_speeds: NDArray[np.float64], dt_s: float) -> None:
        """Add the motion of four wheel speeds (rad/s) over `dt_s`."""
        vx, vy, wz = (float(v) for v in twist_from_wheels(wheel_speeds) * self._scale)
        self.twist = (vx, vy, wz)
        distance, turn = math.hypot(vx, vy) * dt_s, abs(wz) * dt_s
        if distance == 0.0 and turn == 0.0:
            return
        nx, ny, nt, nr = (float(v) for v in self._rng.normal(size=4))
        slip_m = SLIP_M_PER_SQRT_M * math.sqrt(distance)
        dyaw = wz * dt_s + nt * SLIP_RAD_PER_SQRT_M * math.sqrt(distance) + nr * SLIP_RAD_PER_SQRT_RAD * math.sqrt(turn)
        # Midpoint rule, second order: translate at the heading after half of the turn.
        midpoint = Pose2(self.pose.x, self.pose.y, self.pose.yaw + dyaw / 2)
        x, y = midpoint.apply(vx * dt_s + nx * slip_m, vy * dt_s + ny * slip_m)
        self.pose = Pose2(x, y, 0.0) @ Pose2(yaw=self.pose.yaw + dyaw)
