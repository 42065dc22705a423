"""Jumps of the map: they are detected, and each part of the path moves as in a pose graph."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lupin_runtime.geometry import Pose2, wrap_angle
from lupin_runtime.perception.map_jumps import MapMotion

ORIGIN = Pose2()
STEP_S = 1.0  # between the poses of a path, at the speed of an exploring robot
LATER_S = 1e4


def rectangle(width: float = 6.0, height: float = 4.0, step: float = 0.1) -> list[Pose2]:
    """True poses of a lap around a rectangle, turning in place at the corners, to a meter past the start."""
    poses = [Pose2()]
    for length, turn in ((width, 1), (height, 1), (width, 1), (height, 1), (1.0, 0)):
        poses += [poses[-1] @ Pose2(x=step) for _ in [0]]
        for _ in range(round(length / step) - 1):
            poses.append(poses[-1] @ Pose2(x=step))
        for _ in range(8 * turn):
            poses.append(poses[-1] @ Pose2(yaw=math.pi / 16))
    return poses


def drifting(truth: list[Pose2], rng: np.random.Generator, turn_bias: float = 0.0) -> list[Pose2]:
    """Odometry of a path: each step has an error in proportion to its length."""
    odometry = [truth[0]]
    for before, after in itertools.pairwise(truth):
        step = before.inverse() @ after
        length = math.hypot(step.x, step.y) + 0.3 * abs(step.yaw)
        sigma = math.sqrt(length)
        error = Pose2(
            rng.normal(0, 0.02 * sigma), rng.normal(0, 0.02 * sigma), rng.normal(0, 0.012 * sigma) + turn_bias * length
        )
        odometry.append(odometry[-1] @ step @ error)
    return odometry


def optimum(odometry: list[Pose2], first: int, last: int, closing: Pose2) -> list[Pose2]:
    """Return the optimum of a pose graph: odometry edges with the same noise, one closing edge from `first` to `last`."""
    from scipy.optimize import least_squares

    edges = [a.inverse() @ b for a, b in itertools.pairwise(odometry)]
    lengths = [math.hypot(e.x, e.y) + 0.3 * abs(e.yaw) + 1e-3 for e in edges]

    def unpack(v: np.ndarray) -> list[Pose2]:
        rest = [Pose2(*row) for row in v.reshape(-1, 3)]
        return [odometry[0], *rest]

    def residuals(v: np.ndarray) -> np.ndarray:
        poses = unpack(v)
        out = []
        for a, b, edge, length in zip(poses, poses[1:], edges, lengths):
            error = edge.inverse() @ (a.inverse() @ b)
            s = math.sqrt(length)
            out += [error.x / (0.03 * s), error.y / (0.03 * s), wrap_angle(error.yaw) / (0.02 * s)]
        error = closing.inverse() @ (poses[first].inverse() @ poses[last])
        return np.array([*out, error.x / 0.005, error.y / 0.005, wrap_angle(error.yaw) / 0.003])

    n = 3 * (len(odometry) - 1)
    pattern = np.zeros((n + 3, n), np.int8)
    for k in range(len(edges)):
        pattern[3 * k : 3 * k + 3, max(0, 3 * (k - 1)) : 3 * k + 3] = 1
    pattern[n:, max(0, 3 * (first - 1)) : 3 * first] = 1
    pattern[n:, 3 * (last - 1) : 3 * last] = 1
    start = np.array([(p.x, p.y, p.yaw) for p in odometry[1:]]).ravel()
    return unpack(least_squares(residuals, start, jac_sparsity=pattern, x_scale=1.0, ftol=1e-8).x)


def follow(motion: MapMotion, odometry: list[Pose2], map_from_odom: Pose2 = ORIGIN) -> tuple[list[float], list[Any]]:
    """Process a path; returns the path length at each pose, and the jumps."""
    stations, jumps = [], []
    for k, pose in enumerate(odometry):
        jump = motion.update(STEP_S * k, map_from_odom, pose)
        stations.append(motion.traveled)
        if jump is not None:
            jumps.append(jump)
    return stations, jumps


def test_static_map_makes_no_jump() -> None:
    truth = rectangle()
    motion = MapMotion()
    _stations, jumps = follow(motion, truth)
    assert jumps == []
    assert motion.traveled == pytest.approx(21.0 + 0.3 * 2 * math.pi, rel=1e-6)


def test_corrections_of_centimeters_are_no_jump() -> None:
    motion = MapMotion()
    rng = np.random.default_rng(0)
    for k, pose in enumerate(rectangle()):
        assert motion.update(STEP_S * k, Pose2(rng.normal(0, 0.01), rng.normal(0, 0.01), 0.002 * math.sin(k)), pose) is None


@pytest.mark.parametrize("seed", range(3))
def test_loop_closure_moves_old_tags_as_the_pose_graph_does(seed: int) -> None:
    """Tags placed on a drifting lap are wrong by decimeters; the jump of map -> odom alone corrects most of it."""
    rng = np.random.default_rng(seed)
    truth = rectangle()[::3]
    odometry = drifting(truth, rng, turn_bias=0.004)
    first, last = 3, len(truth) - 1
    solved = optimum(odometry, first, last, truth[first].inverse() @ truth[last])
    motion = MapMotion()
    stations, _ = follow(motion, odometry)
    jump = motion.update(LATER_S, solved[-1] @ odometry[-1].inverse(), odometry[-1])
    assert jump is not None
    ahead = Pose2(x=0.8, y=0.3)  # where a tag was seen from each pose
    before, after = [], []
    for station, seen_from, right in zip(stations, odometry, solved):
        seen, should = seen_from @ ahead, right @ ahead
        before.append(seen.distance_to(should))
        after.append((jump.motion_at(station) @ seen).distance_to(should))
    assert max(before) > 0.1
    assert np.mean(after) < 0.35 * np.mean(before)
    assert max(after) < 0.5 * max(before)


@settings(max_examples=30)
@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-0.2, 0.2))
def test_newest_pose_follows_the_graph_and_the_first_stays(x: float, y: float, yaw: float) -> None:
    truth = rectangle()[::4]
    motion = MapMotion()
    stations, _ = follow(motion, truth)
    now = truth[-1]
    moved = Pose2(now.x + x, now.y + y, now.yaw + yaw)
    jump = motion.update(LATER_S, moved @ now.inverse(), now)
    if jump is None:
        assert math.hypot(x, y) <= 0.08 and abs(yaw) <= 0.03
        return
    got = jump.motion_at(stations[-1]) @ now
    assert (got.x, got.y) == pytest.approx((moved.x, moved.y), abs=1e-6)
    assert wrap_angle(got.yaw - moved.yaw) == pytest.approx(0.0, abs=1e-6)
    assert (jump.motion_at(0.0) @ truth[0]).distance_to(truth[0]) < 1e-9


def test_new_map_moves_everything() -> None:
    """After the map was cleared, its frame is elsewhere and only odometry connects the two."""
    truth = rectangle()[::4]
    motion = MapMotion()
    stations, _ = follow(motion, truth)
    new = Pose2(5.0, -3.0, 2.0)
    jump = motion.update(LATER_S, new, truth[-1])
    for station, pose in zip(stations, truth):
        assert jump is not None
        assert (jump.motion_at(station) @ pose).distance_to(new @ pose) < 1e-9
    assert motion.update(LATER_S, new, truth[-1]) is None


def test_path_of_hours_stays_bounded() -> None:
    motion = MapMotion()
    pose = Pose2()
    for k in range(5000):
        pose = pose @ Pose2(x=0.25, yaw=0.01)
        motion.update(STEP_S * k, Pose2(), pose)
    assert len(motion._path) <= 2000


def test_wheel_slip_moves_no_tag() -> None:
    """A table holds the robot for five seconds: odometry continues, and SLAM corrects it in steps."""
    motion = MapMotion()
    held = Pose2(5.8, 0.2, 0.1)
    jumps = []
    for k in range(60):
        motion.update(0.1 * k, Pose2(), Pose2(x=0.1 * k))
    for k in range(50):
        odom = Pose2(x=5.9 + 0.03 * k, yaw=0.01 * k)
        corrected = held @ Pose2(x=5.9 + 0.03 * (k // 3 * 3), yaw=0.01 * (k // 3 * 3)).inverse()
        jump = motion.update(6.0 + 0.1 * k, corrected, odom)
        if k > 0 and jump is not None:
            jumps.append(jump)
    assert jumps
    assert all(jump.motion_at(3.0) == Pose2() and 0.0 < jump.doubt_m < 0.3 for jump in jumps)
    assert motion.unrest_m > 0.03
    motion.update(20.0, corrected, odom)
    assert motion.unrest_m == 0.0
