"""Odometry drifts as the robot's does, the same for the same seed."""

import math

import numpy as np
import pytest

from lupin_runtime.geometry import Pose2, wrap_angle
from lupin_sim.odometry import WheelOdometry
from lupin_sim.wheels import wheels_from_twist

SEEDS = range(40)


def roll(odometry: WheelOdometry, twist: tuple[float, float, float], seconds: float) -> None:
    speeds = wheels_from_twist(np.array(twist))
    for _ in range(round(seconds * 100)):
        odometry.step(speeds, 0.01)


def test_odometry_drifts_by_about_one_percent_of_the_path() -> None:
    """After 20 m straight ahead, the error of 40 robots is 0.3 to 2.4 % of the path, as with real rollers."""
    errors = []
    for seed in SEEDS:
        odometry = WheelOdometry(np.random.default_rng(seed))
        roll(odometry, (0.4, 0.0, 0.0), 50.0)
        errors.append(odometry.pose.distance_to(Pose2(20.0, 0.0)) / 20.0)
    assert 0.003 < float(np.median(errors)) < 0.024
    assert max(errors) < 0.06


def test_odometry_drifts_by_a_few_permille_of_the_rotation() -> None:
    errors = []
    for seed in SEEDS:
        odometry = WheelOdometry(np.random.default_rng(seed))
        roll(odometry, (0.0, 0.0, 1.0), 5 * 2 * math.pi)
        errors.append(abs(wrap_angle(odometry.pose.yaw - 10 * math.pi)) / (10 * math.pi))
    assert 0.0005 < float(np.median(errors)) < 0.006


def test_standing_adds_no_drift() -> None:
    odometry = WheelOdometry(np.random.default_rng(0))
    roll(odometry, (0.0, 0.0, 0.0), 10.0)
    assert odometry.pose == Pose2()


@pytest.mark.parametrize("seed", [0, 1])
def test_same_seed_gives_the_same_drift(seed: int) -> None:
    poses = []
    for _ in range(2):
        odometry = WheelOdometry(np.random.default_rng(seed))
        roll(odometry, (0.3, 0.1, 0.4), 5.0)
        poses.append(odometry.pose)
    assert poses[0] == poses[1]
