"""Goals that navigation gave up because lidar or odometry failed: the mission drives to them again."""

from __future__ import annotations

from lupin_runtime.mission.driving import MAX_SENSOR_LOSSES, SENSORS_LOST_WAIT_S
from lupin_runtime.mission.missions import OK, UNREACHABLE
from lupin_runtime.mission.ports import STATUS_ABORTED, STATUS_CANCELED, STATUS_SUCCEEDED
from tests.support.mission_rig import Rig


def end_with_lost_sensors(rig: Rig, status: int = STATUS_ABORTED) -> None:
    goal = rig.navigation.driving[-1]
    goal.ended = True
    rig.orchestrator.goal_finished(goal.token, status, sensors_lost=True)
    rig.step()


def test_lost_sensors_do_not_use_up_attempts(make_rig: type[Rig]) -> None:
    rig = make_rig(nav_max_attempts=1)
    rig.inspect("1")
    for _ in range(5):
        end_with_lost_sensors(rig)
        assert rig.snapshot.last_event == "navigation has lost lidar or odometry"
        assert not rig.navigation.driving
        rig.step(SENSORS_LOST_WAIT_S + 0.2)
        assert len(rig.navigation.driving) == 1
    rig.arrive()
    assert rig.statuses() == [("1", OK, "")]


def test_tag_is_unreachable_after_minutes_without_sensors(make_rig: type[Rig]) -> None:
    rig = make_rig(nav_max_attempts=1)
    rig.inspect("1")
    for _ in range(MAX_SENSOR_LOSSES + 1):
        assert rig.statuses() == []
        end_with_lost_sensors(rig)
        rig.step(SENSORS_LOST_WAIT_S + 0.2)
    assert rig.statuses() == [("1", UNREACHABLE, "nav_blind")]


def test_lost_sensors_do_not_give_up_the_frontier(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.explore()
    first = rig.navigation.driving[-1].pose
    for _ in range(10):
        end_with_lost_sensors(rig)
        rig.step(1.2)
        assert rig.navigation.driving[-1].pose == first
    assert rig.state == "EXPLORING"


def test_docking_continues_after_lost_sensors(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.explore()
    assert rig.requests.abort().success
    rig.step(3.5)
    for _ in range(5):
        end_with_lost_sensors(rig)
        assert rig.state == "RETURNING"
        rig.step(SENSORS_LOST_WAIT_S + 0.2)
    rig.arrive()
    assert rig.state == "DONE"


def test_succeeded_and_cancelled_goals_ignore_lost_sensors(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.inspect("1", "2")
    end_with_lost_sensors(rig, STATUS_SUCCEEDED)
    assert rig.statuses() == [("1", OK, "")]
    end_with_lost_sensors(rig, STATUS_CANCELED)
    assert rig.snapshot.last_event != "navigation has lost lidar or odometry"


def test_sensor_failure_codes_match_navigation_failures() -> None:
    from nav2_msgs.action import ComputePathToPose, FollowPath

    from lupin_runtime.mission.adapters import sensor_failure_codes
    from lupin_runtime.navigation.actions import error_number
    from lupin_runtime.navigation.decision import Failure

    codes = sensor_failure_codes()
    assert {FollowPath.Result.TF_ERROR, FollowPath.Result.CONTROLLER_TIMED_OUT, ComputePathToPose.Result.TF_ERROR} == codes
    sensor_failures = {failure for failure in Failure if error_number(failure) in codes}
    assert sensor_failures == {Failure.TF_ERROR, Failure.SENSOR_LOST, Failure.NO_POSE}
    assert 0 not in codes
