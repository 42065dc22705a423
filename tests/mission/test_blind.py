"""Goals that navigation gives up because its senses failed: nothing is said of the goal, so it is driven to again."""

from __future__ import annotations

from lupin_runtime.mission.driving import BLIND_WAIT_S, MAX_BLIND
from lupin_runtime.mission.missions import OK, UNREACHABLE
from lupin_runtime.mission.ports import STATUS_ABORTED, STATUS_CANCELED, STATUS_SUCCEEDED


def go_blind(rig, status=STATUS_ABORTED):
    goal = rig.navigation.wanted[-1]
    goal.ended = True
    rig.orchestrator.goal_finished(goal.token, status, blind=True)
    rig.step()


def test_a_tag_is_not_unreachable_because_the_lidar_was_dark(make_rig):
    rig = make_rig(nav_max_attempts=1)
    rig.inspect("1")
    for _ in range(5):
        go_blind(rig)
        assert rig.snapshot.last_event == "navigation is blind: lidar or odometry"
        assert not rig.navigation.wanted
        rig.step(BLIND_WAIT_S + 0.2)
        assert len(rig.navigation.wanted) == 1
    rig.arrive()
    assert rig.statuses() == [("1", OK, "")]


def test_minutes_of_darkness_use_the_attempts_up(make_rig):
    rig = make_rig(nav_max_attempts=1)
    rig.inspect("1")
    for _ in range(MAX_BLIND + 1):
        assert rig.statuses() == []
        go_blind(rig)
        rig.step(BLIND_WAIT_S + 0.2)
    assert rig.statuses() == [("1", UNREACHABLE, "nav_blind")]


def test_a_frontier_is_not_given_up_because_the_lidar_was_dark(make_rig):
    rig = make_rig()
    rig.explore()
    first = rig.navigation.wanted[-1].pose
    for _ in range(10):
        go_blind(rig)
        rig.step(1.2)
        assert rig.navigation.wanted[-1].pose == first
    assert rig.state == "EXPLORING"


def test_the_way_home_is_gone_on_with_after_the_dark(make_rig):
    rig = make_rig()
    rig.explore()
    assert rig.orchestrator.abort().success
    rig.step(3.5)
    for _ in range(5):
        go_blind(rig)
        assert rig.state == "RETURNING"
        rig.step(BLIND_WAIT_S + 0.2)
    rig.arrive()
    assert rig.state == "DONE"


def test_what_arrived_or_was_cancelled_was_not_blind(make_rig):
    rig = make_rig()
    rig.inspect("1", "2")
    go_blind(rig, STATUS_SUCCEEDED)
    assert rig.statuses() == [("1", OK, "")]
    go_blind(rig, STATUS_CANCELED)
    assert rig.snapshot.last_event != "navigation is blind: lidar or odometry"


def test_the_codes_of_navigation_are_told_from_those_of_a_goal():
    from nav2_msgs.action import ComputePathToPose, FollowPath

    from lupin_runtime.mission.adapters import blind_codes
    from lupin_runtime.navigation.actions import error_number
    from lupin_runtime.navigation.executive import Failure

    codes = blind_codes()
    assert {FollowPath.Result.TF_ERROR, FollowPath.Result.CONTROLLER_TIMED_OUT, ComputePathToPose.Result.TF_ERROR} == codes
    blind = {failure for failure in Failure if error_number(failure) in codes}
    assert blind == {Failure.TF_ERROR, Failure.SENSOR_LOST, Failure.NO_POSE}
    assert 0 not in codes
