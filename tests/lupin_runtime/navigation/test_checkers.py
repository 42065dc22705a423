"""The checks whether a goal is reached, and whether the robot is stuck."""

from __future__ import annotations

import math

import pytest

from lupin_runtime.geometry import Pose2
from lupin_runtime.navigation.checkers import GoalChecker, GoalTolerance, ProgressChecker

GOAL = Pose2(1.0, 1.0, 0.0)


def test_goal_is_reached_at_once_within_the_fine_tolerance() -> None:
    assert GoalChecker().reached(Pose2(1.02, 1.0, 0.02), GOAL, 0.0)


def test_robot_within_tolerance_gets_limited_time_to_settle() -> None:
    checker = GoalChecker(GoalTolerance(settle_s=2.0))
    near = Pose2(1.2, 1.0, 0.1)
    assert not checker.reached(near, GOAL, 0.0)
    assert not checker.reached(near, GOAL, 1.9)
    assert checker.reached(near, GOAL, 2.0)


def test_position_stays_reached_while_the_robot_turns() -> None:
    checker = GoalChecker(GoalTolerance(settle_s=0.0))
    assert not checker.reached(Pose2(1.2, 1.0, 1.0), GOAL, 0.0)
    assert checker.reached(Pose2(1.3, 1.0, 0.1), GOAL, 0.1)
    checker.reset()
    assert not checker.reached(Pose2(1.3, 1.0, 0.1), GOAL, 0.2)


def test_headings_are_compared_across_the_wrap_at_pi() -> None:
    checker = GoalChecker(GoalTolerance(settle_s=0.0))
    assert checker.reached(Pose2(1.0, 1.0, math.pi - 0.05), Pose2(1.0, 1.0, -math.pi + 0.05), 0.0)


def test_robot_is_stuck_after_ten_seconds_without_half_a_meter() -> None:
    checker = ProgressChecker()
    assert not checker.stuck(Pose2(), 0.0)
    assert not checker.stuck(Pose2(0.4, 0.0), 9.9)
    assert checker.stuck(Pose2(0.4, 0.0), 10.1)
    checker.reset()
    assert not checker.stuck(Pose2(0.4, 0.0), 30.0)


@pytest.mark.parametrize("moved", [Pose2(0.51, 0.0), Pose2(0.0, 0.0, 0.6), Pose2(0.0, 0.0, -0.6)])
def test_progress_check_restarts_on_movement_or_turning(moved: Pose2) -> None:
    checker = ProgressChecker()
    checker.stuck(Pose2(), 0.0)
    assert not checker.stuck(moved, 9.0)
    assert not checker.stuck(moved, 18.9)
    assert checker.stuck(moved, 19.1)
