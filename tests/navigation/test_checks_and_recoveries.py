"""The executive's parts one by one: goal and progress checkers, recoveries, the lidar's health, the place on a path."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lupin_runtime.geometry import Pose2
from lupin_runtime.navigation.checkers import GoalChecker, GoalTolerance, ProgressChecker
from lupin_runtime.navigation.costmap import BeamPoses, LocalCostmap, Scan
from lupin_runtime.navigation.following import TrackedPath
from lupin_runtime.navigation.recoveries import STANDSTILL, BackUp, Spin, Wait
from lupin_runtime.navigation.scan_health import ScanHealth

GOAL = Pose2(1.0, 1.0, 0.0)


def around(*points: tuple[float, float]):
    costmap = LocalCostmap()
    costmap.roll_to(0.0, 0.0)
    for x, y in points:
        beam = Scan(np.array([math.hypot(x, y)], np.float32), math.atan2(y, x), 0.1)
        costmap.observe(beam, BeamPoses(Pose2(), Pose2()))
    return costmap.snapshot(Pose2())


def test_a_goal_is_reached_at_once_when_it_is_met_finely():
    assert GoalChecker().reached(Pose2(1.02, 1.0, 0.02), GOAL, 0.0)


def test_within_the_tolerance_the_robot_gets_time_to_settle_and_no_more():
    checker = GoalChecker(GoalTolerance(settle_s=2.0))
    near = Pose2(1.2, 1.0, 0.1)
    assert not checker.reached(near, GOAL, 0.0)
    assert not checker.reached(near, GOAL, 1.9)
    assert checker.reached(near, GOAL, 2.0)


def test_the_position_need_be_reached_only_once():
    checker = GoalChecker(GoalTolerance(settle_s=0.0))
    assert not checker.reached(Pose2(1.2, 1.0, 1.0), GOAL, 0.0)
    assert checker.reached(Pose2(1.3, 1.0, 0.1), GOAL, 0.1)
    checker.reset()
    assert not checker.reached(Pose2(1.3, 1.0, 0.1), GOAL, 0.2)


def test_headings_are_compared_round_the_circle():
    checker = GoalChecker(GoalTolerance(settle_s=0.0))
    assert checker.reached(Pose2(1.0, 1.0, math.pi - 0.05), Pose2(1.0, 1.0, -math.pi + 0.05), 0.0)


def test_ten_seconds_without_half_a_metre_are_stuck():
    checker = ProgressChecker()
    assert not checker.stuck(Pose2(), 0.0)
    assert not checker.stuck(Pose2(0.4, 0.0), 9.9)
    assert checker.stuck(Pose2(0.4, 0.0), 10.1)
    checker.reset()
    assert not checker.stuck(Pose2(0.4, 0.0), 30.0)


@pytest.mark.parametrize("moved", [Pose2(0.51, 0.0), Pose2(0.0, 0.0, 0.6), Pose2(0.0, 0.0, -0.6)])
def test_moving_or_turning_starts_the_time_anew(moved):
    checker = ProgressChecker()
    checker.stuck(Pose2(), 0.0)
    assert not checker.stuck(moved, 9.0)
    assert not checker.stuck(moved, 18.9)
    assert checker.stuck(moved, 19.1)


def test_waiting_ends():
    wait = Wait(2.0)
    assert wait.tick(Pose2(), around(), 5.0) == STANDSTILL
    assert wait.tick(Pose2(), around(), 6.9) == STANDSTILL
    assert wait.tick(Pose2(), around(), 7.0) is None


def _run(behaviour, costmap, seconds: float = 20.0) -> Pose2:
    robot, now = Pose2(), 0.0
    while (velocity := behaviour.tick(robot, costmap, now)) is not None:
        robot = robot @ Pose2(velocity[0] * 0.05, velocity[1] * 0.05, velocity[2] * 0.05)
        now += 0.05
        assert now < seconds
    return robot


@pytest.mark.parametrize("angle", [math.pi / 2, -1.0, 4.5])
def test_a_spin_turns_by_its_angle(angle):
    robot = _run(Spin(angle), around())
    assert math.remainder(robot.yaw - angle, 2 * math.pi) == pytest.approx(0.0, abs=0.06)
    assert math.hypot(robot.x, robot.y) < 1e-9


def test_no_spin_where_a_corner_of_the_hull_would_touch():
    assert Spin().tick(Pose2(), around((0.0, 0.26)), 0.0) is not None
    assert Spin().tick(Pose2(0.0, 0.1), around((0.0, 0.26)), 0.0) is None


def test_a_spin_that_the_wheels_do_not_follow_ends_by_time():
    spin = Spin(math.pi / 2)
    ticks = [spin.tick(Pose2(), around(), t * 0.5) for t in range(40)]
    assert ticks[0] is not None
    assert ticks[-1] is None


def test_backing_up_goes_backwards_where_there_is_room():
    robot = _run(BackUp(), around((0.5, 0.0)))
    assert robot.x == pytest.approx(-0.3, abs=0.02)
    assert abs(robot.y) < 0.02


def test_backing_up_goes_sideways_where_a_wall_is_behind():
    robot = _run(BackUp(), around(*((-0.3, y) for y in np.arange(-0.3, 0.3, 0.05)), (0.4, 0.0), (0.4, 0.3)))
    assert math.hypot(robot.x, robot.y) == pytest.approx(0.3, abs=0.03)
    assert abs(robot.y) > 0.15


def test_backing_up_stays_where_nothing_is_free():
    ring = [(0.27 * math.cos(a), 0.27 * math.sin(a)) for a in np.linspace(0, 2 * math.pi, 60)]
    assert BackUp().tick(Pose2(), around(*ring), 0.0) is None


def _scan(value: float, stamp: int) -> Scan:
    return Scan(np.full(360, value, np.float32), 0.0, 0.0175, 0.03, 12.0, stamp)


def test_a_lidar_that_never_spoke_is_blind():
    assert "no scan" in (ScanHealth().reason(0.0) or "")


def test_good_scans_are_trusted_for_a_second():
    health = ScanHealth()
    assert health.take(_scan(1.0, 1), Pose2(), 0.0)
    assert health.reason(1.0) is None
    health.silent()
    assert "nothing comes" in (health.reason(1.2) or "")


@pytest.mark.parametrize("value", [math.nan, 0.0, math.inf, -1.0, 50.0, 0.1])
def test_scans_that_measure_nothing_are_no_scans(value):
    health = ScanHealth()
    assert not health.take(_scan(value, 1), Pose2(), 0.0)
    assert "0 of 360" in (health.reason(0.0) or "")


def test_an_empty_scan_is_none():
    assert not ScanHealth().take(Scan(np.zeros(0, np.float32), 0.0, 0.1), Pose2(), 0.0)


def test_a_stamp_that_stands_still_is_no_new_scan():
    health = ScanHealth()
    assert health.take(_scan(1.0, 7), Pose2(), 0.0)
    assert not health.take(_scan(1.1, 7), Pose2(), 0.5)
    assert "stands still" in (health.reason(1.5) or "")


def test_equal_scans_are_frozen_once_the_robot_moves_and_not_before():
    health = ScanHealth()
    for i in range(30):
        assert health.take(_scan(1.0, i), Pose2(), i * 0.1)
    assert health.reason(3.0) is None
    assert not health.take(_scan(1.0, 31), Pose2(0.11, 0.0), 3.1)
    assert "frozen" in (health.reason(3.1) or "")
    assert health.take(_scan(1.2, 32), Pose2(0.11, 0.0), 3.2)
    assert health.reason(3.2) is None


def test_a_picture_is_as_old_as_its_scan_came_late_whatever_the_clocks_say():
    health, robots_ns = ScanHealth(), 5_000_000_000_000
    for i in range(40):
        late_s = 0.3 if i == 39 else 0.02
        assert health.take(_scan(1.0 + 0.1 * i, robots_ns + i * 100_000_000), Pose2(), i * 0.1 + late_s)
    assert health.age_s(4.3) == pytest.approx(0.1 + 0.28, abs=1e-6)
    # A step of the robot's clock is no delay.
    assert health.take(_scan(7.0, 1_000_000_000), Pose2(), 4.4)
    assert health.age_s(4.4) == 0.0


def test_the_place_on_a_path_moves_only_forward_and_not_across_a_bend():
    leg = np.arange(0.0, 2.0, 0.05)
    out, back = np.column_stack((leg, 0 * leg)), np.column_stack((leg[::-1], 0 * leg + 0.3))
    path = TrackedPath(np.vstack((out, back)))
    for x in np.arange(0.0, 1.5, 0.1):
        path.advance(Pose2(x, 0.2, 0.0))  # nearer to the way back
    assert path.remaining_m == pytest.approx(0.6 + 0.3 + 1.95, abs=0.15)
    assert path.advance(Pose2(0.2, 0.0)) > 1.0


def test_the_local_path_knows_what_is_blocked_and_how_far_the_goal_is():
    along = np.arange(0.0, 3.001, 0.05)
    path = TrackedPath(np.column_stack((along, 0 * along)))
    local = path.local(Pose2(0.0, 0.0, math.pi / 2), Pose2(), around((0.0, 1.0)), 1.7, 0.22)
    assert local.y[-1] == pytest.approx(1.7, abs=0.06)
    assert np.abs(local.x).max() < 1e-9
    blocked = local.y[~local.free]
    assert blocked.min() == pytest.approx(0.8, abs=0.06)
    assert blocked.max() == pytest.approx(1.2, abs=0.06)
    assert local.remaining_m == pytest.approx(3.0, abs=0.01)
