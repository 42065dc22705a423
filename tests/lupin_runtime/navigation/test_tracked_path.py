"""The robot's position on a path, and the part of it that the controller follows."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lupin_runtime.geometry import Pose2
from lupin_runtime.navigation.tracked_path import TrackedPath
from tests.support.obstacles import costmap_with_obstacles


def test_position_on_path_only_advances_and_skips_no_bend() -> None:
    leg = np.arange(0.0, 2.0, 0.05)
    out, back = np.column_stack((leg, 0 * leg)), np.column_stack((leg[::-1], 0 * leg + 0.3))
    path = TrackedPath(np.vstack((out, back)))
    for x in np.arange(0.0, 1.5, 0.1):
        path.advance(Pose2(x, 0.2, 0.0))  # nearer to the returning leg
    assert path.remaining_m == pytest.approx(0.6 + 0.3 + 1.95, abs=0.15)
    assert path.advance(Pose2(0.2, 0.0)) > 1.0


def test_local_path_marks_blocked_points_and_remaining_length() -> None:
    along = np.arange(0.0, 3.001, 0.05)
    path = TrackedPath(np.column_stack((along, 0 * along)))
    local = path.extract_local_path(Pose2(0.0, 0.0, math.pi / 2), Pose2(), costmap_with_obstacles((0.0, 1.0)), 1.7, 0.22)
    assert local.y[-1] == pytest.approx(1.7, abs=0.06)
    assert np.abs(local.x).max() < 1e-9
    blocked = local.y[~local.free]
    assert blocked.min() == pytest.approx(0.8, abs=0.06)
    assert blocked.max() == pytest.approx(1.2, abs=0.06)
    assert local.remaining_m == pytest.approx(3.0, abs=0.01)
