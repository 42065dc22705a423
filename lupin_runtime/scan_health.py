"""Judges whether a laser scan is usable: not if too few beams return, or if the ranges are the same as before."""

from __future__ import annotations

from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2, wrap_angle


class ScanHealth(Enum):
    """The verdict on one scan."""

    GOOD = "good"
    BLIND = "too few beams returned"
    REPEATED = "the ranges repeat bit by bit while the robot stands still"
    FROZEN = "the ranges repeat bit by bit while the wheels turn: the lidar or its driver hangs"


class ScanJudge:
    """Compares each scan with the last one that differed.

    A real lidar never measures the same twice; a simulated one without noise does while the robot stands still. So equal
    ranges mean a frozen lidar only once the odometry has moved by more than `still_m` or `still_rad` meanwhile.
    """

    def __init__(self, still_m: float = 0.02, still_rad: float = 0.02) -> None:
        self._still_m, self._still_rad = still_m, still_rad
        self._ranges: NDArray[np.floating[Any]] | None = None
        self._changed_at = Pose2()

    def judge(self, ranges: NDArray[np.floating[Any]], enough_returns: bool, odom: Pose2) -> ScanHealth:
        """Judge the ranges of a scan that was taken at `odom` (odom_from_base)."""
        if not enough_returns:
            return ScanHealth.BLIND
        if self._ranges is not None and np.array_equal(self._ranges, ranges, equal_nan=True):
            turned = abs(wrap_angle(odom.yaw - self._changed_at.yaw))
            moved = odom.distance_to(self._changed_at) > self._still_m or turned > self._still_rad
            return ScanHealth.FROZEN if moved else ScanHealth.REPEATED
        self._ranges, self._changed_at = ranges.copy(), odom
        return ScanHealth.GOOD
