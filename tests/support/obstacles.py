"""Costmaps with single obstacles."""

from __future__ import annotations

import math

import numpy as np

from lupin_runtime.geometry import Pose2
from lupin_runtime.navigation.costmap import BeamPoses, Costmap, LocalCostmap, RangeScan


def costmap_with_obstacles(*points: tuple[float, float]) -> Costmap:
    """Return a local costmap around the origin, with an obstacle at each point (m): each was hit by one beam."""
    costmap = LocalCostmap()
    costmap.roll_to(0.0, 0.0)
    for x, y in points:
        beam = RangeScan(np.array([math.hypot(x, y)], np.float32), math.atan2(y, x), 0.1)
        costmap.observe(beam, BeamPoses(Pose2(), Pose2()))
    return costmap.snapshot(Pose2())
