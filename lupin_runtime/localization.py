"""How a pose message says where the robot is, how certain that is, and that the robot is lost."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

# Indices of the variances of x, y and yaw in a row-major 6x6 covariance.
PLANAR_VARIANCES = (0, 7, 35)
LOST_YAW_VARIANCE = math.pi**2 / 3.0
"""The variance of a heading that may be any (rad²). Exactly it marks the pose of a robot that localization has lost."""


def planar_variances(message: Any) -> tuple[float, float, float]:
    """Return the variances of x, y (m²) and yaw (rad²) of a PoseWithCovarianceStamped."""
    x, y, yaw = (float(message.pose.covariance[index]) for index in PLANAR_VARIANCES)
    return x, y, yaw


def says_lost(variances: Sequence[float]) -> bool:
    """Return whether these variances of x, y and yaw are those of a lost robot.

    A larger one is not: while odometry is silent, the variance of SLAM's pose grows without bound, and no map is in doubt.
    """
    return len(variances) == len(PLANAR_VARIANCES) and math.isclose(variances[-1], LOST_YAW_VARIANCE, rel_tol=1e-9)
