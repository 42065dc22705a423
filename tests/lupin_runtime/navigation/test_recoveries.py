"""Recoveries: waiting, turning on the spot, backing up."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from lupin_runtime.geometry import Pose2
from lupin_runtime.navigation.recoveries import STANDSTILL, BackUp, Spin, Wait
from tests.support.obstacles import costmap_with_obstacles

if TYPE_CHECKING:
    from lupin_runtime.navigation.costmap.costmaps import Costmap


def test_wait_ends_after_its_duration() -> None:
    wait = Wait(2.0)
    assert wait.tick(Pose2(), costmap_with_obstacles(), 5.0) == STANDSTILL
    assert wait.tick(Pose2(), costmap_with_obstacles(), 6.9) == STANDSTILL
    assert wait.tick(Pose2(), costmap_with_obstacles(), 7.0) is None


def _run(behavior: BackUp | Spin, costmap: Costmap, seconds: float = 20.0) -> Pose2:
    robot, now = Pose2(), 0.0
    while (velocity := behavior.tick(robot, costmap, now)) is not None:
        robot = robot @ Pose2(velocity[0] * 0.05, velocity[1] * 0.05, velocity[2] * 0.05)
        now += 0.05
        assert now < seconds
    return robot


@pytest.mark.parametrize("angle", [math.pi / 2, -1.0, 4.5])
def test_spin_turns_by_its_angle(angle: float) -> None:
    robot = _run(Spin(angle), costmap_with_obstacles())
    assert math.remainder(robot.yaw - angle, 2 * math.pi) == pytest.approx(0.0, abs=0.06)
    assert math.hypot(robot.x, robot.y) < 1e-9


def test_spin_is_refused_if_a_hull_corner_would_touch() -> None:
    assert Spin().tick(Pose2(), costmap_with_obstacles((0.0, 0.26)), 0.0) is not None
    assert Spin().tick(Pose2(0.0, 0.1), costmap_with_obstacles((0.0, 0.26)), 0.0) is None


def test_spin_that_the_wheels_do_not_follow_times_out() -> None:
    spin = Spin(math.pi / 2)
    ticks = [spin.tick(Pose2(), costmap_with_obstacles(), t * 0.5) for t in range(40)]
    assert ticks[0] is not None
    assert ticks[-1] is None


def test_back_up_drives_backwards_if_there_is_room() -> None:
    robot = _run(BackUp(), costmap_with_obstacles((0.5, 0.0)))
    assert robot.x == pytest.approx(-0.3, abs=0.02)
    assert abs(robot.y) < 0.02


def test_back_up_drives_sideways_with_a_wall_behind() -> None:
    robot = _run(BackUp(), costmap_with_obstacles(*((-0.3, y) for y in np.arange(-0.3, 0.3, 0.05)), (0.4, 0.0), (0.4, 0.3)))
    assert math.hypot(robot.x, robot.y) == pytest.approx(0.3, abs=0.03)
    assert abs(robot.y) > 0.15


def test_back_up_stops_if_no_direction_is_free() -> None:
    ring = [(0.27 * math.cos(a), 0.27 * math.sin(a)) for a in np.linspace(0, 2 * math.pi, 60)]
    assert BackUp().tick(Pose2(), costmap_with_obstacles(*ring), 0.0) is None
