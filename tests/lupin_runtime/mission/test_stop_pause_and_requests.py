"""E-stop, pause, low battery, and requests in every state."""

from __future__ import annotations

import math

import pytest

from lupin_runtime.mission.missions import OK, SKIPPED
from lupin_runtime.mission.ports import STATUS_ABORTED
from lupin_runtime.mission.requests import SETTLE_S
from tests.support.mission_rig import Rig
from tests.support.mission_states import BUSY_LEAVES, MOVING_LEAVES


@pytest.mark.parametrize("state", BUSY_LEAVES)
def test_e_stop_holds_until_release_and_resume(make_rig: type[Rig], state: str) -> None:
    rig = make_rig()
    rig.bring_to(state)
    rig.orchestrator.on_estop(True)
    assert not rig.navigation.driving
    rig.localize()
    rig.step(5.0)
    assert rig.snapshot.estop_engaged and rig.snapshot.paused
    assert rig.snapshot.last_event == "e-stop engaged"
    assert "e-stop" in rig.requests.resume().message
    sent = len(rig.navigation.goals)
    for _ in range(10):
        rig.orchestrator.on_estop(False)
        rig.step()
    assert rig.state == state
    assert rig.snapshot.paused and not rig.snapshot.estop_engaged
    assert len(rig.navigation.goals) == sent
    assert rig.requests.resume().success
    rig.climate_bridge.replies = True
    rig.step(7.0)
    assert len(rig.navigation.goals) > sent


@pytest.mark.parametrize("state", ["READY", "DONE", "FAULT", "BOOT"])
def test_e_stop_release_while_idle_starts_nothing(make_rig: type[Rig], state: str) -> None:
    rig = make_rig(ready=state != "BOOT", dependency_timeout_s=1.0)
    if state == "DONE":
        rig.inspect("1")
        rig.end_mission()
    elif state == "FAULT":
        rig = make_rig(ready=False, dependency_timeout_s=1.0)
        rig.navigation.ready = False
        rig.step(2.0)
    assert rig.state == state
    sent = len(rig.navigation.goals)
    rig.orchestrator.on_estop(True)
    rig.orchestrator.on_estop(False)
    rig.step(3.0)
    assert rig.state in (state, "READY")
    assert len(rig.navigation.goals) == sent


@pytest.mark.parametrize("is_running", [True, False], ids=["resume", "start"])
@pytest.mark.parametrize("steps", [0, 1, 3, 5, 10])
def test_request_as_old_as_the_release_moves_nothing(make_rig: type[Rig], steps: int, is_running: bool) -> None:
    rig = make_rig()
    if is_running:
        rig.inspect("1")
    rig.orchestrator.on_estop(True)
    rig.step(1.0)
    rig.orchestrator.on_estop(False)
    for _ in range(steps):
        rig.step(0.1)
    reply = rig.requests.resume() if is_running else rig.requests.start("InspectionMission", ["1"])
    rig.step(3.0)
    assert reply.success == (steps * 0.1 > SETTLE_S)
    assert bool(rig.navigation.driving) == reply.success
    assert reply.success or reply.message.startswith("the e-stop was released less than 0.4 s ago: ")


def test_e_stop_while_paused_needs_resume_after_release(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.inspect("1")
    rig.requests.pause()
    rig.orchestrator.on_estop(True)
    rig.orchestrator.on_estop(False)
    rig.step(1.0)
    assert rig.snapshot.paused
    assert not rig.navigation.driving


def test_e_stop_cancels_goal_that_is_accepted_later(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.navigation.answers_goals = False
    rig.inspect("1")
    rig.orchestrator.on_estop(True)
    rig.navigation.accept(rig.navigation.goals[0])
    assert not rig.navigation.driving


def test_e_stop_drops_goal_waiting_for_a_cancel(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.navigation.answers_cancels = False
    rig.inspect("1")
    rig.requests.abort()
    rig.orchestrator.on_estop(True)
    rig.step(10.0)
    assert len(rig.navigation.goals) == 1


def test_e_stop_while_arm_settles_sends_no_goal(make_rig: type[Rig]) -> None:
    rig = make_rig(arm_patrol_enabled=True, arm_travel_settle_s=3.0)
    rig.inspect("1")
    rig.orchestrator.on_estop(True)
    moves = len(rig.arm.moves)
    rig.step(10.0)
    assert not rig.navigation.goals
    assert len(rig.arm.moves) == moves


@pytest.mark.parametrize("state", MOVING_LEAVES)
def test_pause_cancels_goal_and_resume_sends_it_again(make_rig: type[Rig], state: str) -> None:
    rig = make_rig(nav_max_attempts=1)
    rig.bring_to(state)
    (goal,) = rig.navigation.driving
    assert rig.requests.pause().success
    assert not rig.navigation.driving
    assert "already paused" in rig.requests.pause().message
    rig.step(90.0)
    assert rig.state == state
    assert rig.requests.resume().success
    rig.step(1.5)
    (again,) = rig.navigation.driving
    assert again.pose == goal.pose


def test_pause_does_not_count_as_attempt(make_rig: type[Rig]) -> None:
    rig = make_rig(nav_max_attempts=1)
    rig.inspect("1")
    for _ in range(5):
        rig.requests.pause()
        rig.requests.resume()
    rig.arrive()
    assert rig.statuses() == [("1", OK, "")]


@pytest.mark.parametrize("request_name", ["pause", "abort", "skip_current", "dock", "reset", "resume"])
@pytest.mark.parametrize("state", ["READY", "BOOT", "DONE"])
def test_request_in_wrong_state_is_refused_with_reason(make_rig: type[Rig], state: str, request_name: str) -> None:
    rig = make_rig(ready=state != "BOOT")
    if state == "DONE":
        rig.inspect("1")
        rig.end_mission()
    reply = getattr(rig.requests, request_name)()
    assert not reply.success
    assert reply.message
    assert rig.state == state


@pytest.mark.parametrize("state", ["PREPARE.LOCALIZING", "RETURNING"])
def test_dock_request_is_refused_without_resumable_state(make_rig: type[Rig], state: str) -> None:
    rig = make_rig()
    rig.bring_to(state)
    assert not rig.requests.dock().success


@pytest.mark.parametrize("state", ["EXPLORING", "MONITORING.NAVIGATING", "RETURNING", "PREPARE.LOCALIZING"])
def test_skip_is_refused_outside_inspection(make_rig: type[Rig], state: str) -> None:
    rig = make_rig()
    rig.bring_to(state)
    assert not rig.requests.skip_current().success
    assert rig.state == state


@pytest.mark.parametrize("state", ["INSPECTING.NAVIGATING", "INSPECTING.SCANNING"])
def test_skip_closes_tag_and_continues(make_rig: type[Rig], state: str) -> None:
    rig = make_rig()
    rig.bring_to(state)
    assert rig.requests.skip_current().success
    assert rig.statuses() == [("1", SKIPPED, "skipped_by_operator")]
    assert (rig.state, rig.snapshot.current_target) == ("INSPECTING.NAVIGATING", "2")
    assert len(rig.navigation.driving) == 1


def test_skip_while_paused_closes_tag_without_driving(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.inspect("1", "2")
    rig.requests.pause()
    assert rig.requests.skip_current().success
    assert rig.statuses() == [("1", SKIPPED, "skipped_by_operator")]
    rig.step(5.0)
    assert not rig.navigation.driving
    assert not rig.requests.skip_current().success
    rig.requests.resume()
    assert rig.snapshot.current_target == "2"


@pytest.mark.parametrize("state", ["READY", "DONE", "PREPARE.LOCALIZING"])
def test_low_battery_before_first_drive_pauses(make_rig: type[Rig], state: str) -> None:
    rig = make_rig()
    if state == "PREPARE.LOCALIZING":
        rig.bring_to(state)
    elif state == "DONE":
        rig.inspect("1")
        rig.end_mission()
    rig.orchestrator.on_battery(0.19)
    rig.localize()
    rig.step(2.0)
    assert rig.state == state
    assert rig.snapshot.paused and rig.snapshot.battery_low
    assert not rig.requests.start("InspectionMission", ["1"]).success
    rig.orchestrator.on_battery(0.20)
    rig.step(2.0)
    assert rig.state == state
    assert rig.snapshot.paused and not rig.snapshot.battery_low


def test_low_battery_while_returning_does_not_stop(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.inspect("1")
    rig.arrive()
    rig.orchestrator.on_battery(0.1)
    rig.step()
    rig.arrive()
    assert rig.state == "DONE"


def test_resume_after_e_stop_drives_to_dock_with_low_battery(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.inspect("1")
    rig.orchestrator.on_battery(0.1)
    rig.orchestrator.on_estop(True)
    rig.orchestrator.on_estop(False)
    rig.step(5.0)
    assert not rig.navigation.driving
    assert rig.requests.resume().success
    rig.arrive()
    assert rig.state == "RETURNING"
    assert rig.snapshot.paused


def test_reset_keeps_e_stop_and_low_battery(make_rig: type[Rig]) -> None:
    rig = make_rig(ready=False, dependency_timeout_s=1.0)
    rig.navigation.ready = False
    rig.orchestrator.on_battery(0.1)
    rig.orchestrator.on_estop(True)
    rig.step(2.0)
    assert rig.state == "FAULT"
    rig.navigation.ready = True
    assert rig.requests.reset().success
    assert rig.snapshot.battery_low and rig.snapshot.estop_engaged
    assert "e-stop" in rig.requests.start("InspectionMission", ["1"]).message
    rig.orchestrator.on_estop(False)
    rig.step(SETTLE_S + 0.1)
    assert "battery" in rig.requests.start("InspectionMission", ["1"]).message
    rig.orchestrator.on_battery(0.5)
    rig.localize()
    assert rig.requests.start("InspectionMission", ["1"]).success


@pytest.mark.parametrize("value", [math.nan, math.inf, -1.0])
def test_invalid_battery_percentage_is_not_low(make_rig: type[Rig], value: float) -> None:
    rig = make_rig()
    rig.orchestrator.on_battery(value)
    assert not rig.snapshot.battery_low


def test_shutdown_cancels_goal(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.inspect("1")
    rig.orchestrator.shut_down()
    assert not rig.navigation.driving


def test_new_mission_starts_with_clean_counters(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.inspect("1")
    first = rig.snapshot
    rig.end_mission()
    rig.inspect("2")
    assert rig.snapshot.mission_id != first.mission_id
    assert rig.snapshot.targets_skipped == 0
    assert rig.snapshot.last_error == ""
    assert rig.snapshot.started_at_ns > first.started_at_ns


def test_unreachable_dock_skips_remaining_tags(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.inspect("1", "2")
    rig.requests.dock()
    rig.fail()
    assert rig.state == "DONE"
    assert rig.statuses() == [("1", SKIPPED, "dock_unreachable"), ("2", SKIPPED, "dock_unreachable")]


def test_abort_on_the_way_to_the_dock_skips_tags_as_aborted(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.inspect("1", "2")
    rig.requests.dock()
    assert rig.requests.abort().success
    assert rig.state == "DONE"
    assert rig.statuses() == [("1", SKIPPED, "mission_aborted"), ("2", SKIPPED, "mission_aborted")]


@pytest.mark.parametrize("state", MOVING_LEAVES)
def test_goal_aborted_by_estop_is_resent_only_after_resume(make_rig: type[Rig], state: str) -> None:
    rig = make_rig(nav_max_attempts=1)
    rig.bring_to(state)
    goal, reported = rig.navigation.driving[-1], len(rig.publisher.records)
    goal.ended = True
    rig.orchestrator.goal_finished(goal.token, STATUS_ABORTED, estop=True)  # navigation received the e-stop's state first
    rig.step(1.0)
    rig.orchestrator.on_estop(True)
    rig.step(5.0)
    assert not rig.requests.resume().success
    rig.orchestrator.on_estop(False)
    rig.step(5.0)
    assert not rig.navigation.open
    assert (rig.state, rig.snapshot.paused, rig.snapshot.last_event) == (state, True, "e-stop engaged")
    assert rig.requests.resume().success
    rig.step(3.5)
    assert rig.navigation.driving[-1].pose == goal.pose
    assert len(rig.publisher.records) == reported
