"""Visits to tags: attempts, scans, visual confirmation and the arm."""

from __future__ import annotations

import math

import pytest

from lupin_runtime.mission.missions import OK, SCAN_FAILED, SKIPPED, UNREACHABLE
from lupin_runtime.mission.records import MapPose
from tests.support.mission_rig import Rig


def test_inspection_visits_and_reads_tags_then_returns(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.inspect("1", "2")
    for tag in ("1", "2"):
        assert (rig.state, rig.snapshot.current_target) == ("INSPECTING.NAVIGATING", tag)
        rig.arrive()
    assert rig.state == "RETURNING"
    rig.arrive()
    assert rig.state == "DONE"
    assert rig.statuses() == [("1", OK, ""), ("2", OK, "")]
    assert {record.source for record in rig.publisher.records} == {"InspectionMission"}
    assert rig.last.reading is not None and rig.last.reading.values == (("co2", 400.0),)
    assert (rig.snapshot.targets_total, rig.snapshot.targets_completed) == (2, 2)
    assert rig.last.mission_id == rig.snapshot.mission_id
    assert rig.snapshot.mission_id.startswith("lupin-") and len(rig.snapshot.mission_id) == len("lupin-") + 8


def test_discovered_pose_has_priority_over_layout(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.inspect("1")
    assert (rig.navigation.goals[-1].pose.x, rig.navigation.goals[-1].pose.y) == pytest.approx((2.5, 0.7))
    rig = make_rig()
    rig.discover("1")  # at (2, 1), facing west
    rig.inspect("1")
    assert (rig.navigation.goals[-1].pose.x, rig.navigation.goals[-1].pose.y) == pytest.approx((1.5, 1.0))


def test_each_attempt_uses_the_newest_tag_pose(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.discover("1")
    rig.inspect("1")
    rig.orchestrator.on_tags({"1": MapPose(2.0, 3.0, 0.15, 0.0, 0.0, 0.0, 0.0)})
    rig.fail()
    rig.step()
    assert math.hypot(rig.navigation.goals[-1].pose.x - 2.0, rig.navigation.goals[-1].pose.y - 3.0) < 0.6


def test_tag_is_unreachable_after_failed_attempts(make_rig: type[Rig]) -> None:
    rig = make_rig(nav_max_attempts=2)
    rig.inspect("1", "2")
    rig.fail()
    assert rig.snapshot.last_event == "navigation retry"
    rig.step()
    assert rig.snapshot.current_target == "1"
    rig.fail()
    rig.step()
    assert rig.statuses() == [("1", UNREACHABLE, "nav_status_6")]
    assert rig.last.pose is None and rig.last.reading is None
    assert (rig.snapshot.current_target, rig.snapshot.targets_unreachable) == ("2", 1)


def test_rejected_goal_counts_as_attempt(make_rig: type[Rig]) -> None:
    rig = make_rig(nav_max_attempts=1)
    rig.navigation.answers_goals = False
    rig.inspect("1")
    rig.navigation.reject(rig.navigation.goals[-1])
    assert rig.statuses() == [("1", UNREACHABLE, "nav_rejected")]


@pytest.mark.parametrize("accepted", [True, False])
def test_goal_timeout_counts_from_sending(make_rig: type[Rig], accepted: bool) -> None:
    rig = make_rig(nav_timeout_s=10.0, nav_max_attempts=1)
    rig.navigation.answers_goals = accepted
    rig.inspect("1", "2")
    rig.step(9.5)
    assert rig.snapshot.current_target == "1"
    rig.step(1.0)
    assert rig.statuses() == [("1", UNREACHABLE, "nav_timeout")]
    if not accepted:
        goal = rig.navigation.goals[0]
        before = goal.cancel_requests
        assert before >= 1
        rig.navigation.accept(goal)
        assert goal.cancel_requests == before + 1


@pytest.mark.parametrize(("variance", "detail"), [(0.5, "amcl_drift_var=0.5000"), (math.nan, "amcl_drift_var=unknown")])
def test_inspection_sends_no_goal_with_large_pose_variance(make_rig: type[Rig], variance: float, detail: str) -> None:
    rig = make_rig()
    rig.inspect("1", "2")
    sent = len(rig.navigation.goals)
    rig.localize(variance)
    rig.arrive()
    assert rig.statuses() == [("1", OK, ""), ("2", UNREACHABLE, detail)]
    assert len(rig.navigation.goals) == sent + 1  # the dock's
    assert rig.state == "RETURNING"


def test_monitoring_ignores_pose_variance(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.monitor("1")
    rig.localize(0.9)
    rig.arrive()
    rig.arrive()
    assert [status for _, status, _ in rig.statuses()[-2:]] == [OK, OK]


def test_foreign_cancels_are_refunded_a_limited_number_of_times(make_rig: type[Rig]) -> None:
    rig = make_rig(nav_max_attempts=1)
    rig.inspect("1")
    for _ in range(3):
        rig.end_drive(5)
        sent = len(rig.navigation.goals)
        rig.step(0.5)
        assert len(rig.navigation.goals) == sent  # an e-stop may follow: no goal at once
        rig.step(1.0)
        assert rig.state == "INSPECTING.NAVIGATING"
    rig.end_drive(5)
    assert rig.statuses() == [("1", UNREACHABLE, "nav_status_5")]


def test_goal_is_sent_again_after_navigation_restarts(make_rig: type[Rig]) -> None:
    rig = make_rig(nav_max_attempts=1)
    rig.inspect("1")
    rig.navigation.ready = False
    rig.step(10.0)
    assert rig.state == "INSPECTING.NAVIGATING"
    sent = len(rig.navigation.goals)
    rig.navigation.ready = True
    rig.step(5.0)
    assert len(rig.navigation.goals) == sent + 1
    rig.arrive()
    assert rig.statuses() == [("1", OK, "")]


def test_missing_navigation_uses_up_attempts(make_rig: type[Rig]) -> None:
    rig = make_rig(nav_max_attempts=2, nav_timeout_s=5.0)
    rig.inspect("1")
    rig.navigation.ready = False
    rig.step(20.0)
    assert rig.statuses() == [("1", UNREACHABLE, "nav_unavailable")]


@pytest.mark.parametrize(("status", "error", "detail"), [(1, "no tag 1", "no tag 1"), (7, "", "bridge_status_7")])
def test_bridge_error_fails_the_scan(make_rig: type[Rig], status: int, error: str, detail: str) -> None:
    rig = make_rig(flower_scan_dwell_s=5.0)
    rig.climate_bridge.status, rig.climate_bridge.error = status, error
    rig.inspect("1")
    rig.arrive()
    rig.step()
    assert rig.statuses() == [("1", SCAN_FAILED, detail)]
    assert rig.snapshot.last_event == "scan failed"
    assert rig.snapshot.targets_failed == 1


def test_silent_bridge_times_out_and_late_answer_is_ignored(make_rig: type[Rig]) -> None:
    rig = make_rig(scan_timeout_s=2.0)
    rig.climate_bridge.replies = False
    rig.inspect("1", "2")
    rig.arrive()
    rig.step(2.5)
    assert rig.statuses() == [("1", SCAN_FAILED, "scan_timeout")]
    rig.climate_bridge.reply()
    rig.step()
    assert len(rig.publisher.records) == 1
    assert rig.state == "INSPECTING.NAVIGATING"


def test_dwell_counts_from_bridge_request(make_rig: type[Rig]) -> None:
    rig = make_rig(flower_scan_dwell_s=4.0)
    rig.climate_bridge.replies = False
    rig.inspect("1")
    rig.arrive()
    rig.step(3.0)
    rig.climate_bridge.reply()
    rig.step(0.5)
    assert rig.state == "INSPECTING.SCANNING"
    rig.step(1.0)
    assert rig.statuses() == [("1", OK, "")]


def test_pause_during_dwell_keeps_the_reading(make_rig: type[Rig]) -> None:
    rig = make_rig(flower_scan_dwell_s=4.0)
    rig.inspect("1")
    rig.arrive()
    rig.step(1.0)
    rig.requests.pause()
    rig.step(20.0)
    assert rig.state == "INSPECTING.SCANNING"
    rig.requests.resume()
    assert rig.statuses() == [("1", OK, "")]
    assert rig.climate_bridge.requested == ["1"]


def test_reading_is_published_when_it_is_taken(make_rig: type[Rig]) -> None:
    rig = make_rig(flower_scan_dwell_s=4.0)
    rig.inspect("1", "2")
    rig.arrive()
    assert (rig.state, rig.snapshot.current_target) == ("INSPECTING.SCANNING", "1")
    assert rig.statuses() == [("1", OK, "")] and rig.last.reading is not None
    assert rig.snapshot.targets_completed == 1
    rig.step(4.5)
    assert (rig.state, rig.snapshot.current_target) == ("INSPECTING.NAVIGATING", "2")
    assert rig.statuses() == [("1", OK, "")]


def test_reply_during_a_pause_is_published_at_once(make_rig: type[Rig]) -> None:
    rig = make_rig(flower_scan_dwell_s=4.0)
    rig.climate_bridge.replies = False
    rig.inspect("1")
    rig.arrive()
    rig.requests.pause()
    rig.climate_bridge.reply()
    assert rig.statuses() == [("1", OK, "")] and rig.state == "INSPECTING.SCANNING"


def test_abort_during_the_dwell_keeps_the_reading(make_rig: type[Rig]) -> None:
    rig = make_rig(flower_scan_dwell_s=4.0)
    rig.inspect("1", "2")
    rig.arrive()
    rig.requests.abort()
    assert rig.statuses() == [("1", OK, ""), ("2", SKIPPED, "mission_aborted")]
    assert (rig.snapshot.targets_completed, rig.snapshot.targets_skipped) == (1, 1)


@pytest.mark.parametrize("replied", ["before", "after"])
def test_battery_return_during_the_dwell_keeps_the_reading(make_rig: type[Rig], replied: str) -> None:
    """Before the return, or on the way to the dock; the tag is not read again after the resume."""
    rig = make_rig(flower_scan_dwell_s=4.0)
    rig.climate_bridge.replies = replied == "before"
    rig.inspect("1", "2")
    rig.arrive()
    rig.orchestrator.on_battery(0.1)
    assert rig.state == "RETURNING"
    rig.climate_bridge.reply()
    assert rig.statuses() == [("1", OK, "")]
    rig.arrive()
    rig.orchestrator.on_battery(0.9)
    rig.requests.resume()
    assert (rig.state, rig.snapshot.current_target) == ("INSPECTING.NAVIGATING", "2")
    assert rig.climate_bridge.requested == ["1"]


def test_resume_after_the_last_reading_has_nothing_left_to_visit(make_rig: type[Rig]) -> None:
    rig = make_rig(flower_scan_dwell_s=4.0)
    rig.inspect("1")
    rig.arrive()
    rig.orchestrator.on_battery(0.1)
    rig.arrive()
    rig.orchestrator.on_battery(0.9)
    rig.requests.resume()
    rig.step()
    assert rig.state == "RETURNING"
    assert rig.statuses() == [("1", OK, "")]


def test_reply_after_an_abort_is_ignored(make_rig: type[Rig]) -> None:
    rig = make_rig(flower_scan_dwell_s=4.0)
    rig.climate_bridge.replies = False
    rig.inspect("1")
    rig.arrive()
    rig.requests.abort()
    rig.climate_bridge.reply()
    assert rig.statuses() == [("1", SKIPPED, "mission_aborted")]


def test_late_reply_does_not_count_for_the_next_visit(make_rig: type[Rig]) -> None:
    """The robot was at the dock meanwhile and is on its way to the tag again."""
    rig = make_rig()
    rig.climate_bridge.replies = False
    rig.inspect("1")
    rig.arrive()
    rig.orchestrator.on_battery(0.1)
    rig.arrive()
    rig.orchestrator.on_battery(0.9)
    rig.requests.resume()
    rig.climate_bridge.reply()
    assert rig.statuses() == [] and rig.state == "INSPECTING.NAVIGATING"
    rig.climate_bridge.replies = True
    rig.arrive()
    assert rig.statuses() == [("1", OK, "")]


def test_confirmation_precedes_bridge_request(make_rig: type[Rig]) -> None:
    rig = make_rig(require_visual_confirmation=True)
    rig.confirmer.replies = False
    rig.inspect("1")
    rig.arrive()
    assert (rig.state, rig.snapshot.mission_phase) == ("INSPECTING.SCANNING", "CONFIRMING")
    assert rig.climate_bridge.requested == []
    rig.confirmer.reply()
    rig.step(0.2)
    assert rig.climate_bridge.requested == ["1"]
    assert rig.statuses() == [("1", OK, "")]


@pytest.mark.parametrize(("error", "detail"), [("stale", "stale"), ("", "visual_confirm_missed")])
def test_failed_confirmation_fails_the_scan(make_rig: type[Rig], error: str, detail: str) -> None:
    rig = make_rig(require_visual_confirmation=True)
    rig.confirmer.detected, rig.confirmer.error = False, error
    rig.inspect("1")
    rig.arrive()
    rig.step()
    assert rig.statuses() == [("1", SCAN_FAILED, detail)]


def test_silent_confirmation_times_out(make_rig: type[Rig]) -> None:
    rig = make_rig(require_visual_confirmation=True, visual_confirmation_timeout_s=3.0)
    rig.confirmer.replies = False
    rig.inspect("1")
    rig.arrive()
    rig.step(3.5)
    assert rig.statuses() == [("1", SCAN_FAILED, "confirm_timeout")]


def test_confirmation_while_paused_is_used_after_resume(make_rig: type[Rig]) -> None:
    rig = make_rig(require_visual_confirmation=True)
    rig.confirmer.replies = rig.confirmer.detected = False
    rig.inspect("1")
    rig.arrive()
    rig.requests.pause()
    rig.confirmer.reply()
    rig.step()
    assert rig.state == "INSPECTING.SCANNING"
    rig.requests.resume()
    assert rig.statuses() == [("1", SCAN_FAILED, "visual_confirm_missed")]


def test_arm_inspects_each_tag_and_retracts_before_drives(make_rig: type[Rig]) -> None:
    rig = make_rig(arm_patrol_enabled=True, arm_travel_settle_s=3.2, flower_scan_dwell_s=4.0)
    rig.inspect("1")
    assert rig.arm.moves[-1][0] == "home" and not rig.navigation.goals
    rig.step(3.5)
    rig.arrive()
    assert rig.arm.moves[-1][0] == "inspect"
    rig.step(4.5)
    assert rig.state == "RETURNING"
    assert rig.arm.moves[-1][0] == "home"
    assert len(rig.navigation.goals) == 1
    rig.step(3.5)
    assert len(rig.navigation.goals) == 2


def test_arm_does_not_move_without_patrol(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.inspect("1")
    rig.arrive()
    assert rig.arm.moves == []
