from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lupin_runtime.geometry import Pose2
from lupin_runtime.report.trajectory import TrajectoryBuilder, speeds, write_trajectory


def straight(builder: TrajectoryBuilder, seconds: float, speed: float = 0.5, start_s: float = 0.0) -> None:
    for i in range(round(seconds * 50)):
        t = start_s + i * 0.02
        builder.odom_from_base(t, t, Pose2(t * speed, 0.0, 0.0))


def test_the_path_is_sampled_ten_times_a_second_in_the_map():
    builder = TrajectoryBuilder()
    builder.map_from_odom(0.0, Pose2(1.0, 2.0, math.pi / 2))
    straight(builder, 4.0)
    path = builder.build()
    assert len(path) == 40
    assert path.frame == "map"
    assert (path.x[-1], path.y[-1], path.yaw[-1]) == pytest.approx((1.0, 2.0 + 3.9 * 0.5, math.pi / 2))
    assert path.length_m == pytest.approx(3.9 * 0.5, abs=0.01)


def test_each_pose_is_what_was_published_at_the_time():
    builder = TrajectoryBuilder()
    builder.map_from_odom(0.0, Pose2())
    straight(builder, 1.0)
    builder.map_from_odom(1.0, Pose2(0.0, 0.3, 0.0))
    straight(builder, 1.0, start_s=1.0)
    path = builder.build()
    assert path.y[:10] == pytest.approx(0.0)
    assert path.y[10:] == pytest.approx(0.3)
    assert [(c.t_s, round(c.distance_m, 3)) for c in path.corrections] == [(1.0, 0.3)]
    assert path.length_m == pytest.approx(0.95, abs=0.01)  # the jump was not driven


def test_a_turn_of_the_map_counts_by_how_far_it_moves_the_robot():
    builder = TrajectoryBuilder()
    builder.map_from_odom(0.0, Pose2())
    builder.odom_from_base(0.0, 0.0, Pose2(10.0, 0.0, 0.0))
    builder.map_from_odom(0.1, Pose2(0.0, 0.0, 0.01))
    assert builder.build().corrections[0].distance_m == pytest.approx(0.1, abs=1e-3)


def test_a_standing_robot_drives_nothing():
    builder = TrajectoryBuilder()
    for i in range(500):
        builder.odom_from_base(i * 0.1, i * 0.1, Pose2(0.001 * (i % 2), 0.0, 0.0))
    assert builder.build().length_m == 0.0


def test_without_a_map_the_path_is_the_odometry_and_says_so():
    builder = TrajectoryBuilder()
    straight(builder, 1.0)
    assert builder.build().frame == "odom"


def test_no_transforms_make_an_empty_path():
    path = TrajectoryBuilder().build()
    assert len(path) == 0
    assert path.at(1.0) is None
    assert speeds(path).size == 0


def test_a_clock_that_jumps_back_does_not_end_the_path():
    builder = TrajectoryBuilder()
    for t in (100.0, 100.1, 0.0, 0.1, 0.2):
        builder.odom_from_base(t, t, Pose2())
    assert len(builder.build()) == 5


def test_speed_is_metres_per_second():
    builder = TrajectoryBuilder()
    straight(builder, 5.0, speed=0.4)
    assert speeds(builder.build())[5:-5] == pytest.approx(0.4, abs=0.01)


def test_the_nearest_pose_answers_within_half_a_second():
    builder = TrajectoryBuilder()
    straight(builder, 2.0, speed=1.0)
    path = builder.build()
    assert path.at(1.04).x == pytest.approx(1.0)
    assert path.at(1.06).x == pytest.approx(1.1)
    assert path.at(2.3) is not None
    assert path.at(2.6) is None


@settings(deadline=None)
@given(st.lists(st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-3.1, 3.1)), min_size=1, max_size=20))
def test_tum_lines_read_back_as_the_poses(tmp_path_factory, poses):
    builder = TrajectoryBuilder()
    for i, pose in enumerate(poses):
        builder.odom_from_base(i * 0.1, 12.5 + i * 0.1, Pose2(*pose))
    file = tmp_path_factory.mktemp("tum") / "trajectory.tum"
    write_trajectory(file, builder.build())
    rows = [[float(word) for word in line.split()] for line in file.read_text().splitlines()]
    assert len(rows) == len(poses)
    for i, (row, (x, y, yaw)) in enumerate(zip(rows, poses)):
        assert row[:4] == pytest.approx([12.5 + i * 0.1, x, y, 0.0], abs=1e-6)
        assert 2 * math.atan2(row[6], row[7]) == pytest.approx(yaw, abs=1e-6)
