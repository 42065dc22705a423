"""The mapping core on simulated drives: how true it is, and what it survives."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lupin_runtime.geometry import Pose2
from lupin_runtime.slam.keyframes import composed, relative
from lupin_runtime.slam.local_map import FieldShape
from lupin_runtime.slam.loop_closure import LoopCloser, LoopSettings
from lupin_runtime.slam.mapper import Mapper, MapperSettings
from lupin_runtime.slam.offline import settings_for_logs
from lupin_runtime.slam.scan import Beams, Health

RMSE_M, YAW_RMSE_RAD = 0.05, math.radians(0.5)


def rmse(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))


def test_the_greenhouse_is_mapped_within_five_centimetres_and_half_a_degree(mapped, greenhouse_log, worlds):
    place, yaw = mapped.errors()
    drift, _ = worlds.aligned_errors(greenhouse_log.odom, greenhouse_log.truth)
    assert drift.max() > 0.2  # there was something to correct
    assert rmse(place) < RMSE_M / 2 and place.max() < RMSE_M
    assert rmse(yaw) < YAW_RMSE_RAD / 2 and np.abs(yaw).max() < 2 * YAW_RMSE_RAD
    assert all(step.matched for step in mapped.steps)


def test_the_maps_walls_stand_where_the_truths_do(mapped, greenhouse_log, worlds):
    grid = mapped.mapper.grid()
    start = greenhouse_log.truth[0]
    rows, columns = np.nonzero(grid.cells == 100)
    x = grid.origin_x + (columns + 0.5) * grid.resolution_m
    y = grid.origin_y + (rows + 0.5) * grid.resolution_m
    world = np.array([composed(start, np.array([u, v, 0.0]))[:2] for u, v in zip(x, y)])
    segments = worlds.greenhouse().segments
    a, d = segments[:, :2], segments[:, 2:] - segments[:, :2]
    along = np.clip(((world[:, None] - a) * d).sum(2) / (d * d).sum(1), 0.0, 1.0)
    away = np.hypot(*np.moveaxis(world[:, None] - a - along[..., None] * d, 2, 0)).min(axis=1)
    assert len(world) > 500
    assert np.quantile(away, 0.97) < 0.06


def test_the_first_pose_is_the_maps_origin(mapped):
    np.testing.assert_array_equal(mapped.steps[0].pose, np.zeros(3))


def test_the_same_log_gives_the_same_map(greenhouse_log, drive):
    a, b = drive(greenhouse_log).go(0, 300), drive(greenhouse_log).go(0, 300)
    np.testing.assert_array_equal(a.steps[-1].pose, b.steps[-1].pose)
    np.testing.assert_array_equal(a.mapper.grid().cells, b.mapper.grid().cells)


def test_keyframes_stop_growing_where_everything_is_known(drive, worlds):
    lap = [(1.0, 0.7), (3.6, 0.7), (3.6, 2.2), (1.0, 2.2), (1.0, 0.7)]
    truth = worlds.follow(lap * 5, 0.3, 0.8, 0.1)
    angles = np.linspace(-math.pi, math.pi, 360, endpoint=False)
    log = worlds.record(worlds.greenhouse(), truth, 0.1, angles, 12.0, worlds.Drift(), 5)
    driven = drive(log)
    share = len(truth) // 5
    counts = [len(driven.go(k * share, (k + 1) * share).mapper.graph) for k in range(5)]
    assert counts[0] > 20
    assert counts[-1] - counts[-2] <= 2
    assert counts[-1] < 1.6 * counts[0]
    place, _ = driven.errors()
    assert rmse(place) < RMSE_M / 2


@pytest.mark.parametrize("value", [np.nan, 0.0, np.inf])
def test_seconds_of_meaningless_scans_are_bridged_by_odometry(greenhouse_log, drive, value):
    def blind(k, stamp, odom, ranges):
        return stamp, odom, np.full_like(ranges, value) if 200 <= k < 240 else ranges

    driven = drive(greenhouse_log).go(0, 400, blind)
    assert {step.health for step in driven.steps[200:240]} == {Health.BLIND}
    assert not any(step.matched for step in driven.steps[200:240])
    assert driven.steps[239].covariance[0, 0] > 4 * driven.steps[199].covariance[0, 0]
    place, yaw = driven.errors(first=260)
    assert rmse(place) < RMSE_M and rmse(yaw) < YAW_RMSE_RAD


def test_half_of_the_beams_may_be_nan(greenhouse_log, drive):
    rng = np.random.default_rng(0)

    def holes(k, stamp, odom, ranges):
        return stamp, odom, np.where(rng.random(len(ranges)) < 0.5, np.nan, ranges)

    place, _ = drive(greenhouse_log).go(0, 400, holes).errors()
    assert rmse(place) < RMSE_M


def test_a_frozen_lidar_does_not_hold_the_pose(greenhouse_log, drive):
    def frozen(k, stamp, odom, ranges):
        return stamp, odom, greenhouse_log.ranges[200] if 200 <= k < 240 else ranges

    driven = drive(greenhouse_log).go(0, 400, frozen)
    assert Health.FROZEN in {step.health for step in driven.steps[200:240]}
    assert driven.steps[230].health is Health.FROZEN
    place, _ = driven.errors()
    assert place[200:240].max() < 0.08  # what the odometry alone gets wrong on the way
    assert rmse(place[260:]) < RMSE_M


def test_a_clock_that_steps_back_keeps_the_map(greenhouse_log, drive):
    def stepped(k, stamp, odom, ranges):
        return stamp - 1e6 if k >= 200 else stamp, odom, ranges

    driven = drive(greenhouse_log).go(0, 400, stepped)
    keyframes = len(driven.mapper.graph)
    assert keyframes > 30
    place, _ = driven.errors()
    assert rmse(place) < RMSE_M
    assert any(step.keyframe for step in driven.steps[210:300])  # and goes on


def test_odometry_that_starts_again_at_zero_is_left_out(greenhouse_log, drive):
    back = Pose2(*greenhouse_log.odom[200]).inverse()

    def restarted(k, stamp, odom, ranges):
        return stamp, back @ odom if k >= 200 else odom, ranges

    assert math.hypot(*greenhouse_log.odom[200][:2]) > 1.0
    driven = drive(greenhouse_log).go(0, 400, restarted)
    assert driven.steps[200].odometry_jumped
    assert sum(step.odometry_jumped for step in driven.steps) == 1
    place, _ = driven.errors()
    assert rmse(place) < RMSE_M


def test_odometry_that_starts_again_with_another_heading_is_left_out(greenhouse_log, drive):
    turn = Pose2(0.0, 0.0, 2.5)
    base = Pose2(*greenhouse_log.odom[150])

    def turned(k, stamp, odom, ranges):
        return stamp, base @ turn @ base.inverse() @ odom if k >= 150 else odom, ranges

    driven = drive(greenhouse_log).go(0, 300, turned)
    assert driven.steps[150].odometry_jumped
    place, _ = driven.errors()
    assert rmse(place) < RMSE_M


def test_a_crowd_around_the_robot_is_not_mapped(greenhouse_log, drive):
    rng = np.random.default_rng(0)

    def crowded(k, stamp, odom, ranges):
        crowd = np.repeat(rng.uniform(0.3, 0.9, 36), 10)
        return stamp, odom, crowd + rng.normal(size=360) * 0.005 if 200 <= k < 220 else ranges

    driven = drive(greenhouse_log).go(0, 400, crowded)
    assert not any(step.keyframe for step in driven.steps[200:220])
    assert not any(step.matched for step in driven.steps[201:220])
    place, _ = driven.errors()
    assert rmse(place[225:]) < RMSE_M and place[200:225].max() < 0.1


def test_a_wheel_that_slips_is_caught_by_the_scan(greenhouse_log, drive):
    kick = Pose2(0.35, -0.25, 0.3)
    base = Pose2(*greenhouse_log.odom[150])

    def slipped(k, stamp, odom, ranges):
        return stamp, base @ kick @ base.inverse() @ odom if k >= 150 else odom, ranges

    driven = drive(greenhouse_log).go(0, 300, slipped)
    place, _ = driven.errors()
    assert place[155:].max() < RMSE_M


def test_a_scan_before_anything_is_seen_starts_no_map():
    mapper = Mapper()
    beams = Beams(-math.pi, math.radians(1), 360)
    step = mapper.process(0.0, Pose2(), np.full(360, np.nan), beams)
    assert step.health is Health.BLIND and mapper.place is None and mapper.grid() is None


# -- loops ---------------------------------------------------------------------------------------------------------------


def test_a_long_loop_closes(worlds, drive):
    log = worlds.office_log(1)
    drift, _ = worlds.aligned_errors(log.odom, log.truth)
    assert drift.max() > 20.0
    settings = settings_for_logs(40.0)
    driven = drive(log, settings)
    closed = [k for k in range(len(log.stamps)) if driven.go(k, k + 1).steps[-1].closed_loop]
    assert len(closed) > 20
    final = driven.mapper.graph.poses
    assert len(final) == len(log.truth)  # at such a rate every scan is a keyframe
    place, _ = worlds.aligned_errors(final, log.truth)
    assert rmse(place) < 0.1 and place.max() < 0.4


def test_a_closure_that_corrects_by_metres_needs_a_second_one(worlds, drive):
    log = worlds.office_log(1)
    driven = drive(log, MapperSettings(revisit_m=0.0, loops=None, occupancy=None, field_shape=FieldShape(reach_m=25.0)))
    driven.go(0, len(log.stamps))
    graph = driven.mapper.graph
    # Bend the second half away, as drift would have: every closure now asks for the same large correction.
    half = len(graph) // 2
    bend = np.array([2.0, -1.0, 0.15])
    pivot = graph.poses[half].copy()
    poses = graph.poses.copy()
    for k in range(half, len(graph)):
        poses[k] = composed(composed(pivot, bend), relative(pivot, poses[k]))
    graph.poses = poses
    closer = LoopCloser(LoopSettings(chain=6, tries=3, drift_m=(0.5, 0.02), drift_rad=(0.1, 0.003)), FieldShape(reach_m=25.0))
    believed = []
    for number in range(half + 20, len(graph)):
        found = [closure for closure in closer.look(graph, number) if closure.tail < half]
        if found:
            believed.append(found)
            if len(believed) == 4:
                break
    assert believed
    for found in believed:
        assert len(found) >= 2
        for closure in found:
            truth = relative(log.truth[closure.tail], log.truth[closure.head])
            gap = relative(truth, relative(graph.poses[closure.tail], closure.measured))
            assert math.hypot(gap[0], gap[1]) < 0.4
