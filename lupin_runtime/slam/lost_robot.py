"""Notices that a robot is lost on a saved map, and knows where it can be meanwhile."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.gridmap import FREE, GridMap
from lupin_runtime.localization import LOST_YAW_VARIANCE
from lupin_runtime.slam.amcl import Belief
from lupin_runtime.slam.likelihood_field import OCCUPIED_FROM
from lupin_runtime.slam.relocation import Expected

Array = NDArray[np.floating]

LOST_BELOW = 0.5  # the share of a scan that the map explains: on a complete map 0.9 to 1, beside people 0.6 and more
LOST_AFTER = 3  # updates in a row, 0.75 m of driving: below, the pose is still right to some centimeters


class LostRobot:
    """Judges each update's belief, and remembers where odometry leads from the last pose that a scan determined."""

    def __init__(self, lost: bool = False) -> None:
        self.lost = lost
        self._low = 0
        self._pose: Array | None = None  # where odometry leads from the last pose at which the map explained the scan
        self._driven_m = self._turned_rad = 0.0

    def judge(self, belief: Belief, motion: Array) -> bool:
        """Note an update after a motion, and return whether the robot is lost. An update without a scan changes nothing."""
        self.move(motion)
        if self.lost or belief.explained is None:
            return self.lost
        if belief.explained >= LOST_BELOW:
            self._low = 0
            if belief.refined:
                self._pose, self._driven_m, self._turned_rad = belief.pose, 0.0, 0.0
        else:
            self._low += 1
            self.lost = self._low >= LOST_AFTER
        return self.lost

    @property
    def expected(self) -> Expected | None:
        """Where it can be by odometry; None if the map never explained a scan."""
        return None if self._pose is None else Expected.after(self._pose, self._driven_m, self._turned_rad)

    def found(self) -> None:
        """Note that its place is known again."""
        self.lost, self._low = False, 0

    def move(self, motion: Array) -> None:
        """Note a motion (3,) of the odometry, in the robot's frame."""
        self._driven_m += math.hypot(motion[0], motion[1])
        self._turned_rad += abs(float(motion[2]))
        if self._pose is not None:
            x, y, yaw = self._pose
            c, s = math.cos(yaw), math.sin(yaw)
            self._pose = np.array([x + c * motion[0] - s * motion[1], y + s * motion[0] + c * motion[1], yaw + motion[2]])


def lost_belief(belief: Belief, grid: GridMap) -> Belief:
    """Return what is known of a lost robot: it is anywhere in the map's free space, with any heading."""
    rows, columns = np.nonzero((grid.cells >= FREE) & (grid.cells < OCCUPIED_FROM))
    cell = grid.resolution_m
    spread = [float(np.var(index)) * cell**2 if len(index) else (count * cell) ** 2 / 12.0
              for index, count in ((columns, grid.width), (rows, grid.height))]  # fmt: skip
    return Belief(belief.pose, np.diag([*spread, LOST_YAW_VARIANCE]), False, belief.explained)
