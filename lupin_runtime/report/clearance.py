"""The clearance of the robot: the distance from its outline to the nearest echo of a lidar scan."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2

# MIRTE Master's outline, centered on base_link.
ROBOT_LENGTH_M, ROBOT_WIDTH_M = 0.32, 0.28
# Echoes deeper inside the outline are of the robot itself; those at its edge are of what it touches.
_SELF_ECHO_M = 0.02
# A single stray echo is noise: at 0.3 m even a thin stick returns several beams.
_MIN_ECHOES = 2


def clearance_m(ranges: NDArray[np.float32], angle_min: float, angle_step: float, base_from_laser: Pose2) -> float | None:
    """Return the distance from the robot's outline to the nearest obstacle in meters, 0 at contact.

    `ranges` of shape (beams,) are meters, NaN for no echo; the first beam is at `angle_min`, in radians in the laser frame.
    Returns None if too few beams have an echo.
    """
    angles = base_from_laser.yaw + angle_min + angle_step * np.arange(ranges.size)
    x, y = base_from_laser.x + ranges * np.cos(angles), base_from_laser.y + ranges * np.sin(angles)
    ahead, aside = np.abs(x) - ROBOT_LENGTH_M / 2.0, np.abs(y) - ROBOT_WIDTH_M / 2.0
    is_echo = np.isfinite(ranges) & ((ahead > -_SELF_ECHO_M) | (aside > -_SELF_ECHO_M))
    if np.count_nonzero(is_echo) < _MIN_ECHOES:
        return None
    distance = np.hypot(np.maximum(ahead[is_echo], 0.0), np.maximum(aside[is_echo], 0.0))
    nearest = float(np.partition(distance, _MIN_ECHOES - 1)[_MIN_ECHOES - 1])
    return nearest if math.isfinite(nearest) else None
