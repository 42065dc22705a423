"""Whether navigation trusts the lidar."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lupin_runtime.geometry import Pose2
from lupin_runtime.navigation.costmap import RangeScan
from lupin_runtime.navigation.lidar_monitor import LidarMonitor


def _scan(range_m: float, stamp_ns: int) -> RangeScan:
    return RangeScan(np.full(360, range_m, np.float32), 0.0, 0.0175, 0.03, 12.0, stamp_ns)


def test_lidar_whose_scans_cannot_be_placed_is_not_trusted() -> None:
    monitor = LidarMonitor()
    monitor.refuse("the laser is tilted")
    assert monitor.reason(0.0) == "the laser is tilted"
    assert monitor.accept(_scan(2.0, 1), Pose2(), 1.0)
    monitor.refuse("the laser is tilted")
    assert monitor.reason(1.5) is None
    assert monitor.reason(2.5) == "no usable scan for 1.5 s (the laser is tilted)"


def test_lidar_without_any_scan_is_blind() -> None:
    assert "no scan" in (LidarMonitor().reason(0.0) or "")


def test_good_scan_is_trusted_for_one_second() -> None:
    lidar = LidarMonitor()
    assert lidar.accept(_scan(1.0, 1), Pose2(), 0.0)
    assert lidar.reason(1.0) is None
    lidar.note_silence()
    assert "no message arrives" in (lidar.reason(1.2) or "")


@pytest.mark.parametrize("range_m", [math.nan, 0.0, math.inf, -1.0, 50.0, 0.1])
def test_scan_without_usable_beams_is_refused(range_m: float) -> None:
    lidar = LidarMonitor()
    assert not lidar.accept(_scan(range_m, 1), Pose2(), 0.0)
    assert "0 of 360" in (lidar.reason(0.0) or "")


def test_empty_scan_is_refused() -> None:
    assert not LidarMonitor().accept(RangeScan(np.zeros(0, np.float32), 0.0, 0.1), Pose2(), 0.0)


def test_scan_with_an_unchanged_stamp_is_refused() -> None:
    lidar = LidarMonitor()
    assert lidar.accept(_scan(1.0, 7), Pose2(), 0.0)
    assert not lidar.accept(_scan(1.1, 7), Pose2(), 0.5)
    assert "stamp does not change" in (lidar.reason(1.5) or "")


def test_equal_scans_are_frozen_only_once_the_robot_moves() -> None:
    lidar = LidarMonitor()
    for i in range(30):
        assert lidar.accept(_scan(1.0, i), Pose2(), i * 0.1)
    assert lidar.reason(3.0) is None
    assert not lidar.accept(_scan(1.0, 31), Pose2(0.11, 0.0), 3.1)
    assert "frozen" in (lidar.reason(3.1) or "")
    assert lidar.accept(_scan(1.2, 32), Pose2(0.11, 0.0), 3.2)
    assert lidar.reason(3.2) is None


def test_scan_age_includes_its_delay_despite_clock_offset() -> None:
    lidar, robot_clock_ns = LidarMonitor(), 5_000_000_000_000
    for i in range(40):
        late_s = 0.3 if i == 39 else 0.02
        assert lidar.accept(_scan(1.0 + 0.1 * i, robot_clock_ns + i * 100_000_000), Pose2(), i * 0.1 + late_s)
    assert lidar.age_s(4.3) == pytest.approx(0.1 + 0.28, abs=1e-6)
    # A step of the robot's clock is not a delay.
    assert lidar.accept(_scan(7.0, 1_000_000_000), Pose2(), 4.4)
    assert lidar.age_s(4.4) == 0.0
