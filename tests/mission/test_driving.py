"""One goal at a time, whatever becomes of the answers."""

from __future__ import annotations

import pytest

from lupin_runtime.geometry import Pose2
from lupin_runtime.mission.driving import CANCEL_WAIT_S, Driver, GoalRunner, Outcome

A, B = Pose2(1.0, 0.0, 0.0), Pose2(2.0, 0.0, 0.0)


@pytest.fixture
def rig(make_rig):
    """Only the fakes: the runner under test is our own."""
    rig = make_rig(booted=False)
    rig.runner = GoalRunner(rig.navigation, rig.clock)
    rig.ends = []

    class Desk:
        goal_accepted = staticmethod(rig.runner.accepted)
        goal_rejected = staticmethod(rig.runner.rejected)
        goal_finished = staticmethod(rig.runner.finished)

    rig.navigation.orchestrator = Desk

    def wait(seconds):
        for _ in range(round(seconds / 0.1)):
            rig.clock.s += 0.1
            rig.runner.tick()

    rig.wait = wait
    return rig


def test_the_end_of_a_goal_is_reported_once(rig):
    rig.runner.request(A, rig.ends.append)
    (goal,) = rig.navigation.goals
    assert rig.runner.busy
    rig.navigation.end(goal, 4)
    rig.runner.finished(goal.token, 6)
    assert rig.ends == [Outcome("succeeded")]
    assert not rig.runner.busy


@pytest.mark.parametrize(("status", "end"), [(4, "succeeded"), (5, "canceled"), (6, "failed"), (0, "lost")])
def test_ends_are_told_apart(rig, status, end):
    rig.runner.request(A, rig.ends.append)
    rig.navigation.end(rig.navigation.goals[0], status)
    assert rig.ends[0].end == end
    assert rig.ends[0].detail == ("" if status == 4 else f"nav_status_{status}")


def test_a_goal_that_is_accepted_after_its_cancel_is_cancelled_on_acceptance(rig):
    rig.navigation.answers = False
    rig.runner.request(A, rig.ends.append)
    rig.runner.cancel()
    (goal,) = rig.navigation.goals
    assert goal.cancel_asked == 0
    rig.navigation.accept(goal)
    assert goal.cancel_asked == 1
    assert rig.ends == []


def test_a_goal_that_is_accepted_long_after_everyone_forgot_it_is_cancelled_too(rig):
    rig.navigation.answers = False
    rig.runner.request(A, rig.ends.append)
    rig.runner.cancel()
    rig.wait(60.0)
    rig.navigation.accept(rig.navigation.goals[0])
    assert rig.navigation.goals[0].cancel_asked == 1


def test_a_lost_cancel_is_asked_for_again(rig):
    rig.navigation.acknowledges = False
    rig.runner.request(A, rig.ends.append)
    rig.runner.cancel()
    rig.wait(5.0)
    assert rig.navigation.goals[0].cancel_asked >= 4


def test_the_next_goal_waits_for_the_end_of_the_last(rig):
    rig.navigation.acknowledges = False
    rig.runner.request(A, rig.ends.append)
    rig.runner.request(B, rig.ends.append)
    rig.wait(1.0)
    assert len(rig.navigation.goals) == 1
    rig.navigation.end(rig.navigation.goals[0], 5)
    assert [goal.pose for goal in rig.navigation.goals] == [A, B]
    assert rig.ends == []


def test_the_next_goal_is_forced_when_the_end_of_the_last_is_never_heard(rig):
    rig.navigation.acknowledges = False
    rig.runner.request(A, rig.ends.append)
    rig.runner.request(B, rig.ends.append)
    rig.wait(CANCEL_WAIT_S - 0.2)
    assert len(rig.navigation.goals) == 1
    rig.wait(0.4)
    assert [goal.pose for goal in rig.navigation.goals] == [A, B]
    rig.navigation.end(rig.navigation.goals[0], 5)
    assert rig.runner.busy
    assert rig.ends == []


def test_a_waiting_goal_that_is_cancelled_is_never_sent(rig):
    rig.navigation.acknowledges = False
    rig.runner.request(A, rig.ends.append)
    rig.runner.request(B, rig.ends.append)
    rig.runner.cancel()
    rig.wait(10.0)
    assert [goal.pose for goal in rig.navigation.goals] == [A]


def test_a_server_that_dies_takes_its_goal_along(rig):
    rig.runner.request(A, rig.ends.append)
    rig.navigation.ready = False
    rig.wait(1.0)
    assert rig.ends == []
    rig.wait(2.0)
    assert [outcome.end for outcome in rig.ends] == ["lost"]


def test_a_server_that_blinks_does_not(rig):
    rig.runner.request(A, rig.ends.append)
    for _ in range(5):
        rig.navigation.ready = False
        rig.wait(1.0)
        rig.navigation.ready = True
        rig.wait(0.2)
    assert rig.ends == []
    assert rig.runner.busy


def test_a_goal_given_up_with_its_server_is_cancelled_should_both_come_back(rig):
    rig.navigation.acknowledges = False
    rig.runner.request(A, rig.ends.append)
    rig.navigation.ready = False
    rig.wait(3.0)
    before = rig.navigation.goals[0].cancel_asked
    rig.navigation.ready = True
    rig.wait(2.0)
    assert rig.navigation.goals[0].cancel_asked > before


def test_a_server_that_falls_silent_has_lost_its_goal_and_one_that_never_spoke_has_not(rig):
    rig.runner.request(A, rig.ends.append)
    rig.wait(20.0)
    assert rig.ends == []
    for _ in range(10):
        rig.runner.feedback(1)
        rig.wait(2.0)
    assert rig.ends == []
    rig.wait(4.0)
    assert rig.ends == [Outcome("lost", "nav_silent")]
    assert rig.navigation.goals[0].cancel_asked


def test_a_rejection_is_an_end(rig):
    rig.navigation.answers = False
    rig.runner.request(A, rig.ends.append)
    rig.navigation.reject(rig.navigation.goals[0])
    assert rig.ends == [Outcome("rejected", "nav_rejected")]


def _driver(rig, settle_s=3.2):
    return Driver(rig.runner, rig.arm, rig.clock, True, "home", settle_s)


def test_the_arm_is_taken_in_before_a_drive_and_given_its_time(rig):
    driver = _driver(rig)
    driver.strike("inspect")
    driver.drive(A, rig.ends.append)
    assert [name for name, _ in rig.arm.struck] == ["inspect", "home"]
    assert driver.busy and not rig.navigation.goals
    rig.wait(3.0)
    driver.tick()
    assert not rig.navigation.goals
    rig.wait(0.3)
    driver.tick()
    assert len(rig.navigation.goals) == 1


def test_an_arm_that_is_in_costs_no_time(rig):
    driver = _driver(rig, settle_s=0.0)
    driver.drive(A, rig.ends.append)
    rig.navigation.end(rig.navigation.goals[0], 4)
    driver.drive(B, rig.ends.append)
    assert [name for name, _ in rig.arm.struck] == ["home"]
    assert len(rig.navigation.goals) == 2


def test_a_stop_while_the_arm_settles_sends_no_goal_and_leaves_the_arm_unsure(rig):
    driver = _driver(rig)
    driver.drive(A, rig.ends.append)
    driver.stop()
    rig.wait(5.0)
    driver.tick()
    assert not rig.navigation.goals
    driver.drive(A, rig.ends.append)
    assert [name for name, _ in rig.arm.struck] == ["home", "home"]


def test_a_missing_arm_does_not_hold_the_robot(rig):
    rig.arm.present = False
    _driver(rig).drive(A, rig.ends.append)
    assert len(rig.navigation.goals) == 1
