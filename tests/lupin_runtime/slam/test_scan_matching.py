"""Scan matching: accuracy below a cell, honest covariances, no match of unknown places."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lupin_runtime.geometry import Pose2
from lupin_runtime.slam.local_map import LocalMap, ScanPool
from lupin_runtime.slam.scan import Beams, ScanPoints, ScanReader
from lupin_runtime.slam.scan_matching import Window, match, search
from lupin_runtime.slam.se2 import compose, relative_pose
from tests.support.optional import present
from tests.support.slam_worlds import World, box, greenhouse

ANGLES = np.linspace(-math.pi, math.pi, 360, endpoint=False)
BEAMS = Beams(float(ANGLES[0]), float(ANGLES[1] - ANGLES[0]), 360)
WIDE = np.diag([0.2**2, 0.2**2, 0.1**2])


def scan_at(world: World, pose: np.ndarray | tuple[Any, ...], rng: np.random.Generator, noise: float = 0.008) -> ScanPoints:
    ranges = world.cast(np.asarray(pose, float), ANGLES, 12.0)
    return ScanReader().read(BEAMS, ranges + rng.normal(size=360) * noise)


def local_of(world: World, poses: list[Any], rng: np.random.Generator) -> LocalMap:
    pool = ScanPool()
    for pose in poses:
        pool.add(scan_at(world, pose, rng))
    local = LocalMap()
    local.build(pool, np.arange(len(poses)), np.asarray(poses, float), (float(poses[0][0]), float(poses[0][1])))
    return local


AROUND = [(3.5 + dx, 2.2 + dy, yaw) for dx, dy, yaw in ((0, 0, 0), (0.3, 0, 0.4), (-0.3, 0.05, -0.3), (0.05, 0.2, 1.5))]


@settings(max_examples=30)
@given(
    dx=st.floats(-0.3, 0.3),
    dy=st.floats(-0.3, 0.3),
    turn=st.floats(-0.2, 0.2),
    seed=st.integers(0, 100),
)
def test_offset_of_decimeters_is_recovered_to_millimeters(dx: float, dy: float, turn: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    local = local_of(greenhouse(), AROUND, rng)
    truth = np.array([3.45, 2.25, 0.1])
    guess = truth + np.array([dx, dy, turn])
    found = match(local, scan_at(greenhouse(), truth, rng), guess, WIDE, Window(0.5, 0.3))
    assert found is not None
    gap = relative_pose(truth, found.pose)
    assert math.hypot(gap[0], gap[1]) < 0.012
    assert abs(gap[2]) < math.radians(0.4)
    assert found.score > 0.6 and found.overlap > 0.8


def test_match_errors_agree_with_the_covariance() -> None:
    rng = np.random.default_rng(1)
    local = local_of(greenhouse(), AROUND, rng)
    squared = []
    for _ in range(60):
        truth = np.array([3.45, 2.25, 0.1]) + rng.normal(size=3) * [0.1, 0.1, 0.2]
        found = match(local, scan_at(greenhouse(), truth, rng), truth + rng.normal(size=3) * 0.03, WIDE, Window(0.2, 0.15))
        assert found is not None
        error = found.pose - truth
        squared.append(error @ np.linalg.solve(found.covariance, error))
    # Three degrees of freedom: 3 if exact. This map is exact, but the covariance allows for errors of the map.
    assert np.mean(squared) < 3.0


def test_bare_corridor_leaves_its_direction_to_the_odometry() -> None:
    corridor = World(np.array([[-50.0, -1.0, 50.0, -1.0], [-50.0, 1.0, 50.0, 1.0]]))
    rng = np.random.default_rng(0)
    local = local_of(corridor, [(0, 0, 0), (0.3, 0, 0), (0.6, 0, 0)], rng)
    truth = np.array([0.9, 0.0, 0.0])
    guess = np.array([0.85, 0.05, 0.02])
    found = match(local, scan_at(corridor, truth, rng), guess, np.diag([0.05**2, 0.05**2, 0.05**2]), Window(0.3, 0.15))
    assert found is not None
    assert abs(found.pose[1]) < 0.01 and abs(found.pose[2]) < 0.005
    assert abs(found.pose[0] - guess[0]) < 0.03  # nothing contradicts the odometry in that direction
    sigma = np.sqrt(np.diag(found.covariance))
    assert sigma[0] > 5 * sigma[1]


def test_both_faces_of_a_thin_table_keep_their_place() -> None:
    table = World(np.concatenate((box(0, 0, 8, 8), box(1.5, 0.0, 0.04, 1.0))))
    rng = np.random.default_rng(0)
    local = local_of(table, [(0.5, 0, 0), (2.5, 0, 3.1), (0.5, 0.3, 0.5), (2.5, 0.3, 2.5)], rng)
    for truth in (np.array([0.7, 0.1, 0.1]), np.array([2.3, 0.1, 3.0])):
        found = match(local, scan_at(table, truth, rng), truth + np.array([0.08, -0.05, 0.05]), WIDE, Window(0.3, 0.15))
        assert found is not None
        assert np.hypot(*(found.pose - truth)[:2]) < 0.015


def test_unknown_place_is_not_matched() -> None:
    rng = np.random.default_rng(0)
    local = local_of(greenhouse(), AROUND, rng)
    elsewhere = scan_at(World(box(0, 0, 2.3, 1.7)), (0.3, 0.1, 0.0), rng)
    assert match(local, elsewhere, np.array([3.5, 2.2, 0.0]), WIDE, Window(1.0, 0.5), min_score=0.6) is None


def test_wide_search_equals_the_exhaustive_one() -> None:
    rng = np.random.default_rng(2)
    local = local_of(greenhouse(), AROUND, rng)
    truth = np.array([3.6, 2.3, 0.3])
    points = scan_at(greenhouse(), truth, rng).thinned(0.05)
    guess = truth + np.array([1.9, -1.4, 0.45])
    wide = np.diag([1.0, 1.0, 0.3])
    score, pose = present(search(local, points, guess, wide, Window(2.5, 0.6), 0.2, 0.0))
    gap = relative_pose(truth, pose)
    assert math.hypot(gap[0], gap[1]) < 0.06 and abs(gap[2]) < 0.03
    near, _ = present(search(local, points, truth, wide, Window(0.05, 0.02), 0.2, 0.0))
    assert score >= near - 0.03
    rival = search(local, points, guess, wide, Window(2.5, 0.6), 0.95 * score, 0.0, [pose])
    assert rival is None  # this corner is unique


def test_search_avoids_every_excluded_pose() -> None:
    rng = np.random.default_rng(2)
    local = local_of(greenhouse(), AROUND, rng)
    truth = np.array([3.6, 2.3, 0.3])
    points = scan_at(greenhouse(), truth, rng).thinned(0.05)
    found: list[np.ndarray] = []
    scores = []
    for _ in range(3):
        score, pose = present(search(local, points, truth, np.diag([1.0, 1.0, 0.3]), Window(1.5, 0.4), 0.05, 0.0, found))
        assert all(np.hypot(*(pose - other)[:2]) > 0.35 or abs(pose[2] - other[2]) > 0.2 for other in found)
        found.append(pose)
        scores.append(score)
    assert scores == sorted(scores, reverse=True) and scores[1] < 0.94 * scores[0]


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 0.0, 1e9, -3.0])
def test_invalid_readings_give_no_points(bad: float) -> None:
    ranges = np.full(360, 2.0)
    ranges[10:200] = bad
    scan = ScanReader().read(BEAMS, ranges)
    assert len(scan) == 170
    assert np.isfinite(scan.xy).all() and np.isfinite(scan.normal).all() and np.isfinite(scan.sigma).all()


def test_normals_face_the_sensor_on_flat_walls_only() -> None:
    scan = ScanReader().read(BEAMS, World(box(0, 0, 4, 3)).cast(np.zeros(3), ANGLES, 12.0))
    towards = -(scan.xy * scan.normal).sum(axis=1)
    flat = np.hypot(*scan.normal.T) > 0.5
    assert flat.mean() > 0.9 and (towards[flat] > 0.0).all()
    np.testing.assert_allclose(np.abs(scan.normal[flat]).max(axis=1), 1.0, atol=1e-6)
    corner = np.abs(np.abs(scan.xy[:, 0] / scan.xy[:, 1]) - 4 / 3) < 0.01
    assert not flat[corner].any()


def test_laser_mount_is_applied_to_every_point() -> None:
    beams = Beams(0.0, math.radians(90), 4, Pose2(0.1, 0.2, math.pi / 2))
    np.testing.assert_allclose(
        ScanReader().read(beams, np.ones(4)).xy, [[0.1, 1.2], [-0.9, 0.2], [0.1, -0.8], [1.1, 0.2]], atol=1e-12
    )


def test_motion_during_a_scan_is_undone() -> None:
    world, twist, beam_s = greenhouse(), (0.4, -0.2, 1.5), 0.1 / 360
    seen = np.empty(360)
    start = np.array([3.5, 2.2, 0.3])
    for k in range(360):
        t = k * beam_s
        seen[k] = world.cast(compose(start, np.array([twist[0] * t, twist[1] * t, twist[2] * t])), ANGLES[k : k + 1], 12.0)[0]  # type: ignore[arg-type]
    undone = ScanReader().read(BEAMS, seen, twist, beam_s)
    local = local_of(world, AROUND, np.random.default_rng(0))
    tight = np.diag([0.1**2, 0.1**2, 0.1**2])
    found = match(local, undone, start, tight, Window(0.2, 0.2))
    skewed = match(local, ScanReader().read(BEAMS, seen), start, tight, Window(0.2, 0.2))
    assert found is not None
    gap = relative_pose(start, found.pose)
    assert math.hypot(gap[0], gap[1]) < 0.01 and abs(gap[2]) < 0.004
    assert skewed is not None
    assert abs(relative_pose(start, skewed.pose)[2]) > 0.03


@pytest.mark.parametrize(("minimum", "step", "count"), [(math.nan, 0.1, 9), (0.0, 0.0, 9), (0.0, math.inf, 9), (0.0, 0.1, 1)])
def test_laser_without_geometry_is_refused(minimum: float, step: float, count: int) -> None:
    with pytest.raises(ValueError, match="make no scan"):
        Beams(minimum, step, count)


def test_wrong_number_of_ranges_is_refused() -> None:
    with pytest.raises(ValueError, match="expected 360 ranges, found 7"):
        ScanReader().read(BEAMS, np.ones(7))
