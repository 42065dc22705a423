"""The mapping core on simulated drives: accuracy, and sensor faults that it survives."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from lupin_runtime.geometry import Pose2
from lupin_runtime.scan_health import ScanHealth
from lupin_runtime.slam.local_map import FieldShape
from lupin_runtime.slam.loop_closure import LoopCloser, LoopSettings
from lupin_runtime.slam.mapper import Mapper, MapperSettings
from lupin_runtime.slam.offline import settings_for_logs
from lupin_runtime.slam.scan import Beams
from lupin_runtime.slam.se2 import compose, relative_pose
from tests.support import slam_worlds
from tests.support.mapping_run import MappingRun
from tests.support.optional import present

if TYPE_CHECKING:
    from tests.support.slam_worlds import Log

RMSE_M, YAW_RMSE_RAD = 0.05, math.radians(0.5)


def rmse(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))


def test_greenhouse_is_mapped_within_5_cm_and_half_a_degree(mapped: MappingRun, greenhouse_log: Log) -> None:
    place, yaw = mapped.errors()
    drift, _ = slam_worlds.aligned_errors(greenhouse_log.odom, greenhouse_log.truth)
    assert drift.max() > 0.2  # the odometry was worse
    assert rmse(place) < RMSE_M / 2 and place.max() < RMSE_M
    assert rmse(yaw) < YAW_RMSE_RAD / 2 and np.abs(yaw).max() < 2 * YAW_RMSE_RAD
    assert all(result.matched for result in mapped.results)


def test_mapped_walls_match_the_true_walls(mapped: MappingRun, greenhouse_log: Log) -> None:
    grid = mapped.mapper.grid()
    start = greenhouse_log.truth[0]
    assert grid is not None
    rows, columns = np.nonzero(grid.cells == 100)
    x = grid.origin_x + (columns + 0.5) * grid.resolution_m
    y = grid.origin_y + (rows + 0.5) * grid.resolution_m
    world = np.array([compose(start, np.array([u, v, 0.0]))[:2] for u, v in zip(x, y)])
    segments = slam_worlds.greenhouse().segments
    a, d = segments[:, :2], segments[:, 2:] - segments[:, :2]
    along = np.clip(((world[:, None] - a) * d).sum(2) / (d * d).sum(1), 0.0, 1.0)
    away = np.hypot(*np.moveaxis(world[:, None] - a - along[..., None] * d, 2, 0)).min(axis=1)
    assert len(world) > 500
    assert np.quantile(away, 0.97) < 0.06


def test_first_pose_is_the_map_origin(mapped: MappingRun) -> None:
    np.testing.assert_array_equal(mapped.results[0].pose, np.zeros(3))


def test_same_log_gives_the_same_map(greenhouse_log: Log) -> None:
    a, b = MappingRun(greenhouse_log).process(0, 300), MappingRun(greenhouse_log).process(0, 300)
    np.testing.assert_array_equal(a.results[-1].pose, b.results[-1].pose)
    np.testing.assert_array_equal(present(a.mapper.grid()).cells, present(b.mapper.grid()).cells)


def test_keyframes_stop_growing_in_known_space() -> None:
    lap = [(1.0, 0.7), (3.6, 0.7), (3.6, 2.2), (1.0, 2.2), (1.0, 0.7)]
    truth = slam_worlds.follow(lap * 5, 0.3, 0.8, 0.1)
    angles = np.linspace(-math.pi, math.pi, 360, endpoint=False)
    log = slam_worlds.record(slam_worlds.greenhouse(), truth, 0.1, angles, 12.0, slam_worlds.Drift(), 5)
    run = MappingRun(log)
    share = len(truth) // 5
    counts = [len(run.process(k * share, (k + 1) * share).mapper.graph) for k in range(5)]
    assert counts[0] > 20
    assert counts[-1] - counts[-2] <= 2
    assert counts[-1] < 1.6 * counts[0]
    place, _ = run.errors()
    assert rmse(place) < RMSE_M / 2


@pytest.mark.parametrize("value", [np.nan, 0.0, np.inf])
def test_unusable_scans_are_bridged_by_odometry(greenhouse_log: Log, value: float) -> None:
    def blind(k: int, stamp: float, odom: Pose2, ranges: np.ndarray) -> tuple[float, Pose2, np.ndarray]:
        return stamp, odom, np.full_like(ranges, value) if 200 <= k < 240 else ranges

    run = MappingRun(greenhouse_log).process(0, 400, blind)
    assert {result.health for result in run.results[200:240]} == {ScanHealth.BLIND}
    assert not any(result.matched for result in run.results[200:240])
    assert run.results[239].covariance[0, 0] > 4 * run.results[199].covariance[0, 0]
    place, yaw = run.errors(first=260)
    assert rmse(place) < RMSE_M and rmse(yaw) < YAW_RMSE_RAD


def test_half_of_the_beams_may_be_nan(greenhouse_log: Log) -> None:
    rng = np.random.default_rng(0)

    def holes(_k: int, stamp: float, odom: Pose2, ranges: np.ndarray) -> tuple[float, Pose2, np.ndarray]:
        return stamp, odom, np.where(rng.random(len(ranges)) < 0.5, np.nan, ranges)

    place, _ = MappingRun(greenhouse_log).process(0, 400, holes).errors()
    assert rmse(place) < RMSE_M


def test_frozen_lidar_does_not_hold_the_pose(greenhouse_log: Log) -> None:
    def frozen(k: int, stamp: float, odom: Pose2, ranges: np.ndarray) -> tuple[float, Pose2, np.ndarray]:
        return stamp, odom, greenhouse_log.ranges[200] if 200 <= k < 240 else ranges

    run = MappingRun(greenhouse_log).process(0, 400, frozen)
    assert ScanHealth.FROZEN in {result.health for result in run.results[200:240]}
    assert run.results[230].health is ScanHealth.FROZEN
    place, _ = run.errors()
    assert place[200:240].max() < 0.08  # the error of the odometry alone
    assert rmse(place[260:]) < RMSE_M


def test_clock_stepping_back_keeps_the_map(greenhouse_log: Log) -> None:
    def stepped(k: int, stamp: float, odom: Pose2, ranges: np.ndarray) -> tuple[float, Pose2, np.ndarray]:
        return stamp - 1e6 if k >= 200 else stamp, odom, ranges

    run = MappingRun(greenhouse_log).process(0, 400, stepped)
    keyframes = len(run.mapper.graph)
    assert keyframes > 30
    place, _ = run.errors()
    assert rmse(place) < RMSE_M
    assert any(result.keyframe for result in run.results[210:300])  # and mapping continues


def test_odometry_reset_to_zero_is_left_out(greenhouse_log: Log) -> None:
    back = Pose2(*greenhouse_log.odom[200]).inverse()

    def restarted(k: int, stamp: float, odom: Pose2, ranges: np.ndarray) -> tuple[float, Pose2, np.ndarray]:
        return stamp, back @ odom if k >= 200 else odom, ranges

    assert math.hypot(*greenhouse_log.odom[200][:2]) > 1.0
    run = MappingRun(greenhouse_log).process(0, 400, restarted)
    assert run.results[200].odometry_jumped
    assert sum(result.odometry_jumped for result in run.results) == 1
    place, _ = run.errors()
    assert rmse(place) < RMSE_M


def test_odometry_reset_to_another_heading_is_left_out(greenhouse_log: Log) -> None:
    turn = Pose2(0.0, 0.0, 2.5)
    base = Pose2(*greenhouse_log.odom[150])

    def turn_odometry(k: int, stamp: float, odom: Pose2, ranges: np.ndarray) -> tuple[float, Pose2, np.ndarray]:
        return stamp, base @ turn @ base.inverse() @ odom if k >= 150 else odom, ranges

    run = MappingRun(greenhouse_log).process(0, 300, turn_odometry)
    assert run.results[150].odometry_jumped
    place, _ = run.errors()
    assert rmse(place) < RMSE_M


def test_crowd_around_the_robot_is_not_mapped(greenhouse_log: Log) -> None:
    rng = np.random.default_rng(0)

    def crowded(k: int, stamp: float, odom: Pose2, ranges: np.ndarray) -> tuple[float, Pose2, np.ndarray]:
        crowd = np.repeat(rng.uniform(0.3, 0.9, 36), 10)
        return stamp, odom, crowd + rng.normal(size=360) * 0.005 if 200 <= k < 220 else ranges

    run = MappingRun(greenhouse_log).process(0, 400, crowded)
    assert not any(result.keyframe for result in run.results[200:220])
    assert not any(result.matched for result in run.results[201:220])
    place, _ = run.errors()
    assert rmse(place[225:]) < RMSE_M and place[200:225].max() < 0.1


def test_wheel_slip_is_corrected_by_the_scan(greenhouse_log: Log) -> None:
    kick = Pose2(0.35, -0.25, 0.3)
    base = Pose2(*greenhouse_log.odom[150])

    def slipped(k: int, stamp: float, odom: Pose2, ranges: np.ndarray) -> tuple[float, Pose2, np.ndarray]:
        return stamp, base @ kick @ base.inverse() @ odom if k >= 150 else odom, ranges

    run = MappingRun(greenhouse_log).process(0, 300, slipped)
    place, _ = run.errors()
    assert place[155:].max() < RMSE_M


def test_unusable_first_scan_starts_no_map() -> None:
    mapper = Mapper()
    beams = Beams(-math.pi, math.radians(1), 360)
    result = mapper.process(0.0, Pose2(), np.full(360, np.nan), beams)
    assert result.health is ScanHealth.BLIND and mapper.anchored_pose is None and mapper.grid() is None


# -- loops ---------------------------------------------------------------------------------------------------------------


def test_long_loop_closes() -> None:
    log = slam_worlds.office_log(1)
    drift, _ = slam_worlds.aligned_errors(log.odom, log.truth)
    assert drift.max() > 20.0
    settings = settings_for_logs(40.0)
    run = MappingRun(log, settings)
    closed = [k for k in range(len(log.stamps)) if run.process(k, k + 1).results[-1].closed_loop]
    assert len(closed) > 20
    final = run.mapper.graph.poses
    assert len(final) == len(log.truth)  # at this rate every scan is a keyframe
    place, _ = slam_worlds.aligned_errors(final, log.truth)
    assert rmse(place) < 0.1 and place.max() < 0.4


def test_closure_that_corrects_by_meters_needs_a_second_one() -> None:
    log = slam_worlds.office_log(1)
    run = MappingRun(log, MapperSettings(revisit_m=0.0, loops=None, occupancy=None, field_shape=FieldShape(reach_m=25.0)))
    run.process(0, len(log.stamps))
    graph = run.mapper.graph
    # Bend the second half away, as drift does: every closure requires the same large correction now.
    half = len(graph) // 2
    bend = np.array([2.0, -1.0, 0.15])
    pivot = graph.poses[half].copy()
    poses = graph.poses.copy()
    for k in range(half, len(graph)):
        poses[k] = compose(compose(pivot, bend), relative_pose(pivot, poses[k]))
    graph.poses = poses
    closer = LoopCloser(LoopSettings(chain=6, tries=3, drift_m=(0.5, 0.02), drift_rad=(0.1, 0.003)), FieldShape(reach_m=25.0))
    believed = []
    for number in range(half + 20, len(graph)):
        found = [closure for closure in closer.find_closures(graph, number) if closure.tail < half]
        if found:
            believed.append(found)
            if len(believed) == 4:
                break
    assert believed
    for found in believed:
        assert len(found) >= 2
        for closure in found:
            truth = relative_pose(log.truth[closure.tail], log.truth[closure.head])
            gap = relative_pose(truth, relative_pose(graph.poses[closure.tail], closure.measured))
            assert math.hypot(gap[0], gap[1]) < 0.4
