"""Quantities over time: localization error, real-time factor and clearance, and why one is missing."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.geometry import Pose2
from lupin_runtime.gridmap import GridMap
from lupin_runtime.report.clearance import clearance_m
from lupin_runtime.report.log_builder import LogBuilder
from lupin_runtime.report.map_history import MAX_SNAPSHOTS, MapHistory
from lupin_runtime.report.run_log import ClockSample, RunLog, TimedPosition
from lupin_runtime.report.series import keep_extremes, localization_error, real_time_factor, run_series
from lupin_runtime.report.trajectory import Trajectory, TrajectoryBuilder


def drive(seconds: int, offset_m: float = 0.0) -> Trajectory:
    """Return a straight drive of 1 m/s in the map, stamped from 100 s; `offset_m` beside the line y = 0."""
    path = TrajectoryBuilder()
    path.map_from_odom(0.0, Pose2(0.0, offset_m, 0.0))
    for i in range(10 * seconds):
        path.odom_from_base(i / 10, 100.0 + i / 10, Pose2(i / 10, 0.0, 0.0))
    return path.build()


def truth(*stamps_s: float) -> list[TimedPosition]:
    return [TimedPosition(stamp_s, stamp_s - 100.0, 0.0) for stamp_s in stamps_s]


def test_localization_error_is_the_distance_to_the_truth() -> None:
    series = localization_error(drive(10, offset_m=0.3), truth(100.0, 101.0, 102.0, 103.0))
    assert [value for _, value in series.points] == pytest.approx([0.3] * len(series.points))
    assert (series.points[0][0], series.points[-1][0]) == pytest.approx((0.0, 3.0))  # no value after the truth's end
    assert series.missing == ""


def test_localization_error_has_no_value_where_truth_is_missing() -> None:
    series = localization_error(drive(10), truth(100.0, 100.5, 107.0, 107.5))
    times = [t for t, _ in series.points]
    assert not [t for t in times if 0.5 < t < 7.0]
    assert max(times) == pytest.approx(7.5)


@pytest.mark.parametrize(
    ("trajectory", "stamps_s", "words"),
    [
        (TrajectoryBuilder().build(), (100.0, 101.0), "no transforms of the robot"),
        (replace(drive(2), frame="odom"), (100.0, 101.0), "has no map"),
        (drive(2), (), "there is no ground truth"),
        (drive(2), (500.0, 501.0), "does not cover the time"),
    ],
)
def test_missing_localization_error_has_a_reason(trajectory: Trajectory, stamps_s: tuple[float, ...], words: str) -> None:
    series = localization_error(trajectory, truth(*stamps_s))
    assert not series.points
    assert words in series.missing


def clocks(rate: float, seconds: int, wall_start_s: float = 1.7e9) -> list[ClockSample]:
    return [ClockSample(i * rate, 5.0 + i * rate, wall_start_s + i) for i in range(seconds)]


@pytest.mark.parametrize("rate", [0.25, 1.0, 4.0])
def test_real_time_factor_is_simulated_per_real_second(rate: float) -> None:
    series = real_time_factor(clocks(rate, 30))
    assert len(series.points) > 20
    assert [value for _, value in series.points] == pytest.approx([rate] * len(series.points))


def test_real_time_factor_shows_a_stall() -> None:
    stalled = [*clocks(1.0, 20), *(ClockSample(19.0, 24.0, 1.7e9 + 20 + i) for i in range(10))]
    assert real_time_factor(stalled).low == pytest.approx((19.0, 0.0))


@pytest.mark.parametrize(
    ("samples", "words"),
    [
        ([], "no messages"),
        ([ClockSample(i, 1.7e9 + i, 1.7e9 + i) for i in range(9)], "ROS time is the wall clock"),
        (clocks(1.0, 2), "too short"),
    ],
)
def test_missing_real_time_factor_has_a_reason(samples: list[ClockSample], words: str) -> None:
    series = real_time_factor(samples)
    assert not series.points
    assert words in series.missing


def test_missing_clearance_has_a_reason() -> None:
    assert run_series(RunLog(), []).clearance_m.missing == "the recording has no lidar scans"


@pytest.mark.parametrize(
    ("range_m", "bearing_deg", "expected_m"),
    [(1.16, 0.0, 1.0), (1.14, 90.0, 1.0), (1.16, 180.0, 1.0), (0.15, 0.0, 0.0)],
)
def test_clearance_is_measured_from_the_outline(range_m: float, bearing_deg: float, expected_m: float) -> None:
    bearing = math.radians(bearing_deg)
    ranges = np.full(3, range_m, np.float32)
    assert clearance_m(ranges, bearing - 1e-3, 1e-3, Pose2()) == pytest.approx(expected_m, abs=2e-3)


def test_clearance_ignores_the_robot_and_single_echoes() -> None:
    own, stray, wall = 0.05, 0.4, 2.16
    ranges = np.array([own, stray, wall, wall, np.nan], np.float32)
    assert clearance_m(ranges, 0.0, 1e-4, Pose2()) == pytest.approx(2.0, abs=1e-3)
    assert clearance_m(np.array([np.nan, own, stray], np.float32), 0.0, 1e-4, Pose2()) is None


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=400), st.integers(4, 40))
def test_thinned_series_keeps_its_extremes_and_order(values: list[float], count: int) -> None:
    points = [(float(i), value) for i, value in enumerate(values)]
    kept = keep_extremes(points, count)
    assert len(kept) <= count + 2
    assert (min(v for _, v in kept), max(v for _, v in kept)) == (min(values), max(values))
    assert list(kept) == sorted(set(kept) & set(points))


def test_map_history_is_bounded_and_spread_over_the_run() -> None:
    history = MapHistory()
    for t_s in range(0, 7200, 5):
        history.add(float(t_s), GridMap(np.full((4, 6), t_s % 100, np.int8), 0.05, -1.0, 2.0))
    times = [snapshot.t_s for snapshot in history.snapshots]
    assert MAX_SNAPSHOTS // 3 < len(times) <= MAX_SNAPSHOTS
    assert times[0] == 0.0 and times[-1] > 6900.0
    assert max(b - a for a, b in pairwise(times)) < 7200 / MAX_SNAPSHOTS * 3
    assert history.snapshots[3].grid.cells.tolist() == [[times[3] % 100] * 6] * 4
    assert (history.snapshots[3].grid.origin_x, history.snapshots[3].grid.origin_y) == (-1.0, 2.0)


@pytest.mark.parametrize(
    ("roll", "kept"), [(0.0, 1), (math.pi, 1), (math.radians(30.0), 0)], ids=["level", "hanging", "tilted"]
)
def test_scans_of_a_report_follow_the_lidars_mount(roll: float, kept: int) -> None:
    def vector(**parts: float) -> SimpleNamespace:
        return SimpleNamespace(**{"x": 0.0, "y": 0.0, "z": 0.0, **parts})

    builder = LogBuilder()
    mount = SimpleNamespace(translation=vector(x=0.1), rotation=vector(x=math.sin(roll / 2.0), w=math.cos(roll / 2.0)))
    header = SimpleNamespace(frame_id="/base_link", stamp=SimpleNamespace(sec=0, nanosec=0))
    transform = SimpleNamespace(header=header, child_frame_id="laser", transform=mount)
    builder.add("/tf_static", 0, 0, SimpleNamespace(transforms=[transform]))
    limits = {"range_min": 0.0, "range_max": 0.0, "angle_min": 0.5, "angle_increment": 0.1}
    header = SimpleNamespace(frame_id="laser", stamp=SimpleNamespace(sec=1, nanosec=0))
    builder.add("/scan", 10**9, 10**9, SimpleNamespace(header=header, ranges=[1.0, 2.0], **limits))
    assert len(builder.log.scans) == len(builder.log.clearance) == kept
    if kept:
        assert builder.log.scans[0].angle_min == (0.5 if roll == 0.0 else -0.5)
        np.testing.assert_array_equal(builder.log.scans[0].ranges, [1.0, 2.0])
