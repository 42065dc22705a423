"""The path that the report takes from recorded transforms."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.geometry import Pose2
from lupin_runtime.report.trajectory import TrajectoryBuilder, speeds, write_trajectory


def drive_straight(builder: TrajectoryBuilder, seconds: float, speed: float = 0.5, start_s: float = 0.0) -> None:
    for i in range(round(seconds * 50)):
        t = start_s + i * 0.02
        builder.odom_from_base(t, t, Pose2(t * speed, 0.0, 0.0))


def test_path_is_sampled_at_10_hz_in_the_map_frame() -> None:
    builder = TrajectoryBuilder()
    builder.map_from_odom(0.0, Pose2(1.0, 2.0, math.pi / 2))
    drive_straight(builder, 4.0)
    path = builder.build()
    assert len(path) == 40
    assert path.frame == "map"
    assert (path.x[-1], path.y[-1], path.yaw[-1]) == pytest.approx((1.0, 2.0 + 3.9 * 0.5, math.pi / 2))
    assert path.length_m == pytest.approx(3.9 * 0.5, abs=0.01)


def test_pose_uses_the_transforms_of_its_time() -> None:
    builder = TrajectoryBuilder()
    builder.map_from_odom(0.0, Pose2())
    drive_straight(builder, 1.0)
    builder.map_from_odom(1.0, Pose2(0.0, 0.3, 0.0))
    drive_straight(builder, 1.0, start_s=1.0)
    path = builder.build()
    assert path.y[:10] == pytest.approx(0.0)
    assert path.y[10:] == pytest.approx(0.3)
    assert [(c.t_s, round(c.distance_m, 3)) for c in path.corrections] == [(1.0, 0.3)]
    assert path.length_m == pytest.approx(0.95, abs=0.01)  # the jump was not driven


def test_correction_by_rotation_is_measured_at_the_robot() -> None:
    builder = TrajectoryBuilder()
    builder.map_from_odom(0.0, Pose2())
    builder.odom_from_base(0.0, 0.0, Pose2(10.0, 0.0, 0.0))
    builder.map_from_odom(0.1, Pose2(0.0, 0.0, 0.01))
    assert builder.build().corrections[0].distance_m == pytest.approx(0.1, abs=1e-3)


def test_standing_robot_has_length_zero() -> None:
    builder = TrajectoryBuilder()
    for i in range(500):
        builder.odom_from_base(i * 0.1, i * 0.1, Pose2(0.001 * (i % 2), 0.0, 0.0))
    assert builder.build().length_m == 0.0


def test_path_without_map_is_odometry() -> None:
    builder = TrajectoryBuilder()
    drive_straight(builder, 1.0)
    assert builder.build().frame == "odom"


def test_path_without_transforms_is_empty() -> None:
    path = TrajectoryBuilder().build()
    assert len(path) == 0
    assert path.at(1.0) is None
    assert speeds(path).size == 0


def test_path_continues_after_clock_jumps_back() -> None:
    builder = TrajectoryBuilder()
    for t in (100.0, 100.1, 0.0, 0.1, 0.2):
        builder.odom_from_base(t, t, Pose2())
    assert len(builder.build()) == 5


def test_speed_is_in_meters_per_second() -> None:
    builder = TrajectoryBuilder()
    drive_straight(builder, 5.0, speed=0.4)
    assert speeds(builder.build())[5:-5] == pytest.approx(0.4, abs=0.01)


def test_at_returns_nearest_pose_within_half_a_second() -> None:
    builder = TrajectoryBuilder()
    drive_straight(builder, 2.0, speed=1.0)
    path = builder.build()
    for t_s, x in ((1.04, 1.0), (1.06, 1.1)):
        pose = path.at(t_s)
        assert pose is not None and pose.x == pytest.approx(x)
    assert path.at(2.3) is not None
    assert path.at(2.6) is None


@given(st.lists(st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-3.1, 3.1)), min_size=1, max_size=20))
def test_tum_file_round_trips_poses(tmp_path_factory: pytest.TempPathFactory, poses: list[tuple[float, float, float]]) -> None:
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
