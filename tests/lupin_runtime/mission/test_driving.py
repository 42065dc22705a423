"""GoalRunner: one goal at a time, with answers that are late or lost. Driver: the arm before a drive."""

from __future__ import annotations

import pytest

from lupin_runtime.geometry import Pose2
from lupin_runtime.mission.config import MissionConfig
from lupin_runtime.mission.driving import Driver
from lupin_runtime.mission.goal_runner import CANCEL_WAIT_S, DriveResult, GoalRunner
from tests.support.mission_rig import Rig

A, B = Pose2(1.0, 0.0, 0.0), Pose2(2.0, 0.0, 0.0)


class RunnerRig:
    """A GoalRunner with the mission's fakes."""

    def __init__(self, fakes: Rig) -> None:
        self.navigation, self.clock, self.arm = fakes.navigation, fakes.clock, fakes.arm
        self.runner = GoalRunner(self.navigation, self.clock)
        self.ends: list[DriveResult] = []
        self.navigation.goal_listener = self

    def goal_accepted(self, token: int) -> None:
        self.runner.accepted(token)

    def goal_rejected(self, token: int) -> None:
        self.runner.rejected(token)

    def goal_finished(self, token: int, status: int) -> None:
        self.runner.finished(token, status)

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.1)):
            self.clock.s += 0.1
            self.runner.tick()


@pytest.fixture
def rig(make_rig: type[Rig]) -> RunnerRig:
    return RunnerRig(make_rig(ready=False))


def test_goal_result_is_reported_once(rig: RunnerRig) -> None:
    rig.runner.request(A, rig.ends.append)
    (goal,) = rig.navigation.goals
    assert rig.runner.busy
    rig.navigation.end(goal, 4)
    rig.runner.finished(goal.token, 6)
    assert rig.ends == [DriveResult("succeeded")]
    assert not rig.runner.busy


@pytest.mark.parametrize(("status", "end"), [(4, "succeeded"), (5, "canceled"), (6, "failed"), (0, "lost")])
def test_action_status_maps_to_result(rig: RunnerRig, status: int, end: str) -> None:
    rig.runner.request(A, rig.ends.append)
    rig.navigation.end(rig.navigation.goals[0], status)
    assert rig.ends[0].end == end
    assert rig.ends[0].detail == ("" if status == 4 else f"nav_status_{status}")


def test_goal_accepted_after_cancel_is_cancelled(rig: RunnerRig) -> None:
    rig.navigation.answers_goals = False
    rig.runner.request(A, rig.ends.append)
    rig.runner.cancel()
    (goal,) = rig.navigation.goals
    before = goal.cancel_requests  # which may have overtaken the goal
    rig.navigation.accept(goal)
    assert goal.cancel_requests == before + 1
    assert rig.ends == []


def test_goal_whose_acceptance_is_lost_is_cancelled(rig: RunnerRig) -> None:
    rig.navigation.answers_goals = False
    rig.runner.request(A, rig.ends.append)
    rig.runner.cancel()
    (goal,) = rig.navigation.goals
    assert goal.cancel_requests == 1
    rig.wait(5.0)
    assert goal.cancel_requests >= 5
    rig.runner.request(B, rig.ends.append)
    assert [goal.pose for goal in rig.navigation.goals] == [A, B]


def test_forgotten_goal_is_cancelled_on_acceptance(rig: RunnerRig) -> None:
    rig.navigation.answers_goals = False
    rig.runner.request(A, rig.ends.append)
    rig.runner.cancel()
    rig.wait(60.0)
    (goal,) = rig.navigation.goals
    before = goal.cancel_requests
    rig.navigation.accept(goal)
    assert goal.cancel_requests == before + 1


def test_unacknowledged_cancel_is_repeated(rig: RunnerRig) -> None:
    rig.navigation.answers_cancels = False
    rig.runner.request(A, rig.ends.append)
    rig.runner.cancel()
    rig.wait(5.0)
    assert rig.navigation.goals[0].cancel_requests >= 4


def test_next_goal_waits_for_end_of_cancelled_goal(rig: RunnerRig) -> None:
    rig.navigation.answers_cancels = False
    rig.runner.request(A, rig.ends.append)
    rig.runner.request(B, rig.ends.append)
    rig.wait(1.0)
    assert len(rig.navigation.goals) == 1
    rig.navigation.end(rig.navigation.goals[0], 5)
    assert [goal.pose for goal in rig.navigation.goals] == [A, B]
    assert rig.ends == []


def test_next_goal_is_sent_after_cancel_timeout(rig: RunnerRig) -> None:
    rig.navigation.answers_cancels = False
    rig.runner.request(A, rig.ends.append)
    rig.runner.request(B, rig.ends.append)
    rig.wait(CANCEL_WAIT_S - 0.2)
    assert len(rig.navigation.goals) == 1
    rig.wait(0.4)
    assert [goal.pose for goal in rig.navigation.goals] == [A, B]
    rig.navigation.end(rig.navigation.goals[0], 5)
    assert rig.runner.busy
    assert rig.ends == []


def test_cancelled_waiting_goal_is_never_sent(rig: RunnerRig) -> None:
    rig.navigation.answers_cancels = False
    rig.runner.request(A, rig.ends.append)
    rig.runner.request(B, rig.ends.append)
    rig.runner.cancel()
    rig.wait(10.0)
    assert [goal.pose for goal in rig.navigation.goals] == [A]


def test_goal_is_lost_with_its_server(rig: RunnerRig) -> None:
    rig.runner.request(A, rig.ends.append)
    rig.navigation.ready = False
    rig.wait(1.0)
    assert rig.ends == []
    rig.wait(2.0)
    assert [result.end for result in rig.ends] == ["lost"]


def test_goal_survives_short_discovery_gaps(rig: RunnerRig) -> None:
    rig.runner.request(A, rig.ends.append)
    for _ in range(5):
        rig.navigation.ready = False
        rig.wait(1.0)
        rig.navigation.ready = True
        rig.wait(0.2)
    assert rig.ends == []
    assert rig.runner.busy


def test_lost_goal_is_cancelled_when_server_returns(rig: RunnerRig) -> None:
    rig.navigation.answers_cancels = False
    rig.runner.request(A, rig.ends.append)
    rig.navigation.ready = False
    rig.wait(3.0)
    before = rig.navigation.goals[0].cancel_requests
    rig.navigation.ready = True
    rig.wait(2.0)
    assert rig.navigation.goals[0].cancel_requests > before


def test_goal_is_lost_when_feedback_stops(rig: RunnerRig) -> None:
    rig.runner.request(A, rig.ends.append)
    rig.wait(20.0)
    assert rig.ends == []
    for _ in range(10):
        rig.runner.feedback(1)
        rig.wait(2.0)
    assert rig.ends == []
    rig.wait(4.0)
    assert rig.ends == [DriveResult("lost", "nav_silent")]
    assert rig.navigation.goals[0].cancel_requests


def test_rejection_is_reported(rig: RunnerRig) -> None:
    rig.navigation.answers_goals = False
    rig.runner.request(A, rig.ends.append)
    rig.navigation.reject(rig.navigation.goals[0])
    assert rig.ends == [DriveResult("rejected", "nav_rejected")]


def _driver(rig: RunnerRig, settle_s: float = 3.2) -> Driver:
    return Driver(rig.runner, rig.arm, rig.clock, MissionConfig(arm_patrol_enabled=True, arm_travel_settle_s=settle_s))


def test_arm_retracts_and_settles_before_drive(rig: RunnerRig) -> None:
    driver = _driver(rig)
    driver.move_arm("inspect")
    driver.drive(A, rig.ends.append)
    assert [name for name, _ in rig.arm.moves] == ["inspect", "home"]
    assert driver.busy and not rig.navigation.goals
    rig.wait(3.0)
    driver.tick()
    assert not rig.navigation.goals
    rig.wait(0.3)
    driver.tick()
    assert len(rig.navigation.goals) == 1


def test_retracted_arm_does_not_move_again(rig: RunnerRig) -> None:
    driver = _driver(rig, settle_s=0.0)
    driver.drive(A, rig.ends.append)
    rig.navigation.end(rig.navigation.goals[0], 4)
    driver.drive(B, rig.ends.append)
    assert [name for name, _ in rig.arm.moves] == ["home"]
    assert len(rig.navigation.goals) == 2


def test_stop_while_arm_settles_sends_no_goal(rig: RunnerRig) -> None:
    driver = _driver(rig)
    driver.drive(A, rig.ends.append)
    driver.stop()
    rig.wait(5.0)
    driver.tick()
    assert not rig.navigation.goals
    driver.drive(A, rig.ends.append)
    assert [name for name, _ in rig.arm.moves] == ["home", "home"]


def test_missing_arm_does_not_block_drive(rig: RunnerRig) -> None:
    rig.arm.present = False
    _driver(rig).drive(A, rig.ends.append)
    assert len(rig.navigation.goals) == 1
