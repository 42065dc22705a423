"""The mission from start to end, and every way in which it may go wrong, on fakes."""

from __future__ import annotations

import math

import pytest

from lupin_runtime.geometry import Pose2
from lupin_runtime.mission.missions import OK, SCAN_FAILED, SKIPPED, UNREACHABLE

# -- boot, start, localization -----------------------------------------------------------------------------------------


def test_boot_waits_for_navigation_and_the_bridge_and_ends_every_goal_left_behind(make_rig):
    rig = make_rig(booted=False)
    rig.navigation.ready = False
    rig.step(5.0)
    assert rig.state == "BOOT"
    rig.navigation.ready = True
    rig.step()
    assert rig.state == "READY"
    assert rig.navigation.cancelled_all == 1


@pytest.mark.parametrize("required", [False, True])
def test_boot_waits_for_the_visual_gate_only_when_it_is_required(make_rig, required):
    rig = make_rig(booted=False, require_visual_confirmation=required)
    rig.gate.ready = False
    rig.step()
    assert rig.state == ("BOOT" if required else "READY")


def test_missing_dependencies_end_in_fault_and_reset_leads_out(make_rig):
    rig = make_rig(booted=False, dependency_timeout_s=3.0)
    rig.greenhouse.ready = False
    rig.step(3.5)
    assert rig.state == "FAULT"
    assert rig.snapshot.last_event == "dependencies not ready"
    assert "get_tag_reading" in rig.outlet.lines[-2]
    assert not rig.orchestrator.start().success
    assert rig.orchestrator.reset().success
    assert rig.state == "READY"
    assert rig.snapshot.last_error == ""


def test_boot_goes_on_while_the_e_stop_is_engaged_since_nothing_moves(make_rig):
    rig = make_rig(booted=False)
    rig.orchestrator.heard_estop(True)
    rig.step()
    assert rig.state == "READY"


@pytest.mark.parametrize(
    ("arguments", "wanted"),
    [
        (("GardeningMission", [], 0), "unknown mission type"),
        (("InspectionMission", ["1", "99"], 0), "unknown tag ids: '99'"),
        (("ExplorationMission", [], -1), "discovery goal"),
    ],
)
def test_a_start_that_makes_no_sense_is_refused(make_rig, arguments, wanted):
    rig = make_rig()
    reply = rig.orchestrator.start(*arguments)
    assert not reply.success
    assert wanted in reply.message
    assert rig.state == "READY"
    assert rig.snapshot.mission_id == ""


def test_a_start_without_any_known_tag_is_refused(make_rig):
    from lupin_runtime.mission.layout import Layout

    assert "empty" in make_rig(layout=Layout()).orchestrator.start().message


def test_a_goal_parameter_of_zero_is_refused_and_zero_in_the_request_takes_the_parameter(make_rig):
    assert not make_rig(discovery_goal=0).orchestrator.start("ExplorationMission").success
    rig = make_rig(discovery_goal=3)
    assert rig.orchestrator.start("ExplorationMission").success
    assert rig.snapshot.discovery_goal == 3


def test_a_start_in_boot_names_what_is_missing(make_rig):
    rig = make_rig(booted=False)
    rig.greenhouse.ready = False
    assert "/greenhouse_bridge/get_tag_reading" in rig.orchestrator.start().message


def test_a_second_start_is_refused(make_rig):
    rig = make_rig()
    rig.inspect("1")
    assert "mission already running" in rig.orchestrator.start().message


@pytest.mark.parametrize("state", ["READY", "DONE"])
def test_a_start_while_e_stopped_is_refused_and_a_release_starts_nothing(make_rig, state):
    rig = make_rig()
    if state == "DONE":
        rig.inspect("1")
        rig.orchestrator.abort()
        rig.orchestrator.abort()
    assert rig.state == state
    sent = len(rig.navigation.goals)
    rig.orchestrator.heard_estop(True)
    reply = rig.orchestrator.start("InspectionMission", ["1"])
    assert not reply.success
    assert "e-stop" in reply.message
    rig.orchestrator.heard_estop(False)
    rig.step(5.0)
    assert rig.state == state
    assert len(rig.navigation.goals) == sent


def test_the_tags_of_an_inspection_come_from_the_request_then_the_parameter_then_all_known(make_rig):
    rig = make_rig(tag_sequence=("2", "1"))
    rig.inspect("0")
    assert rig.snapshot.targets_total == 1
    rig = make_rig(tag_sequence=("2", "1"))
    rig.inspect()
    assert (rig.snapshot.targets_total, rig.snapshot.current_target) == (2, "2")
    rig = make_rig()
    rig.discover("7")
    rig.inspect()
    assert (rig.snapshot.targets_total, rig.snapshot.current_target) == (4, "0")


def test_prepare_waits_for_a_pose_that_can_be_trusted(make_rig):
    rig = make_rig()
    rig.localize(0.3)
    rig.inspect("1")
    assert (rig.state, rig.snapshot.mission_phase) == ("PREPARE.LOCALIZING", "LOCALIZING")
    rig.localize(0.25)
    rig.step()
    assert rig.state == "INSPECTING.NAVIGATING"


@pytest.mark.parametrize("variance", [0.3, math.nan])
def test_prepare_without_a_trusted_pose_ends_in_fault(make_rig, variance):
    rig = make_rig(localization_timeout_s=4.0)
    rig.localize(variance)
    rig.inspect("1")
    rig.step(5.0)
    assert rig.state == "FAULT"
    assert rig.snapshot.last_error == "localization_failed"
    assert not rig.navigation.goals


def test_time_spent_paused_is_not_spent_localizing(make_rig):
    rig = make_rig(localization_timeout_s=4.0)
    rig.localize(9.0)
    rig.inspect("1")
    rig.orchestrator.pause()
    rig.step(60.0)
    assert rig.state == "PREPARE.LOCALIZING"
    rig.orchestrator.resume()
    rig.step(3.0)
    assert rig.state == "PREPARE.LOCALIZING"
    rig.step(2.0)
    assert rig.state == "FAULT"


def test_the_dock_is_where_the_first_mission_started_and_stays_there(make_rig):
    rig = make_rig(dock_pose=(0.0, 0.0, 1.5))
    rig.world.pose = Pose2(3.0, 4.0, 0.2)
    for _ in range(2):
        rig.inspect("1")
        rig.orchestrator.abort()
        assert rig.navigation.goals[-1].pose == Pose2(3.0, 4.0, 1.5)
        rig.arrive()
        assert rig.state == "DONE"
        rig.world.pose = Pose2(-1.0, 0.0, 0.0)


def test_a_dock_pose_that_is_given_is_kept_and_without_a_transform_it_is_the_origin(make_rig):
    rig = make_rig(dock_pose=(1.0, 2.0, 0.5))
    rig.world.pose = Pose2(3.0, 4.0, 0.2)
    rig.inspect("1")
    rig.orchestrator.abort()
    assert rig.navigation.goals[-1].pose == Pose2(1.0, 2.0, 0.5)
    rig = make_rig()
    rig.world.pose = None
    rig.inspect("1")
    rig.orchestrator.abort()
    assert rig.navigation.goals[-1].pose == Pose2()


# -- inspection --------------------------------------------------------------------------------------------------------


def test_an_inspection_visits_its_tags_reads_them_and_comes_home(make_rig):
    rig = make_rig()
    rig.inspect("1", "2")
    for tag in ("1", "2"):
        assert (rig.state, rig.snapshot.current_target) == ("INSPECTING.NAVIGATING", tag)
        rig.arrive()
    assert rig.state == "RETURNING"
    rig.arrive()
    assert rig.state == "DONE"
    assert rig.statuses() == [("1", OK, ""), ("2", OK, "")]
    assert {record.source for record in rig.outlet.records} == {"InspectionMission"}
    assert rig.last.reading.values == (("co2", 400.0),)
    assert (rig.snapshot.targets_total, rig.snapshot.targets_completed) == (2, 2)
    assert rig.last.mission_id == rig.snapshot.mission_id
    assert rig.snapshot.mission_id.startswith("lupin-") and len(rig.snapshot.mission_id) == len("lupin-") + 8


def test_a_goal_faces_the_tag_of_the_layout_and_a_discovered_tag_is_taken_where_it_was_seen(make_rig):
    rig = make_rig()
    rig.inspect("1")
    assert (rig.navigation.goals[-1].pose.x, rig.navigation.goals[-1].pose.y) == pytest.approx((2.5, 0.7))
    rig = make_rig()
    rig.discover("1")  # at (2, 1), facing west
    rig.inspect("1")
    assert (rig.navigation.goals[-1].pose.x, rig.navigation.goals[-1].pose.y) == pytest.approx((1.5, 1.0))


def test_each_visit_takes_the_newest_pose_of_its_tag(make_rig):
    from lupin_runtime.mission.approach import TagPose

    rig = make_rig()
    rig.discover("1")
    rig.inspect("1")
    rig.orchestrator.heard_tags({"1": TagPose(2.0, 3.0, 0.15, *([0.0] * 3), 0.0)})
    rig.fail()
    rig.step()
    assert math.hypot(rig.navigation.goals[-1].pose.x - 2.0, rig.navigation.goals[-1].pose.y - 3.0) < 0.6


def test_failed_goals_use_up_the_attempts_and_leave_the_tag_unreachable(make_rig):
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


def test_a_rejected_goal_is_an_attempt(make_rig):
    rig = make_rig(nav_max_attempts=1)
    rig.navigation.answers = False
    rig.inspect("1")
    rig.navigation.reject(rig.navigation.goals[-1])
    assert rig.statuses() == [("1", UNREACHABLE, "nav_rejected")]


@pytest.mark.parametrize("accepted", [True, False])
def test_a_goal_times_out_from_when_it_was_sent_even_if_it_is_never_accepted(make_rig, accepted):
    rig = make_rig(nav_timeout_s=10.0, nav_max_attempts=1)
    rig.navigation.answers = accepted
    rig.inspect("1", "2")
    rig.step(9.5)
    assert rig.snapshot.current_target == "1"
    rig.step(1.0)
    assert rig.statuses() == [("1", UNREACHABLE, "nav_timeout")]
    if not accepted:
        rig.navigation.accept(rig.navigation.goals[0])
        assert rig.navigation.goals[0].cancel_asked == 1


@pytest.mark.parametrize(("variance", "detail"), [(0.5, "amcl_drift_var=0.5000"), (math.nan, "amcl_drift_var=unknown")])
def test_an_inspection_s_leg_is_refused_while_the_robot_is_lost(make_rig, variance, detail):
    rig = make_rig()
    rig.inspect("1", "2")
    sent = len(rig.navigation.goals)
    rig.localize(variance)
    rig.arrive()
    assert rig.statuses() == [("1", OK, ""), ("2", UNREACHABLE, detail)]
    assert len(rig.navigation.goals) == sent + 1  # the dock's
    assert rig.state == "RETURNING"


def test_where_slam_localizes_a_drift_does_not_stop_the_sweep(make_rig):
    rig = make_rig()
    rig.monitor("1")
    rig.localize(0.9)
    rig.arrive()
    rig.arrive()
    assert [status for _, status, _ in rig.statuses()[-2:]] == [OK, OK]


def test_a_foreign_cancel_is_no_attempt_but_not_for_ever(make_rig):
    rig = make_rig(nav_max_attempts=1)
    rig.inspect("1")
    for _ in range(3):
        rig.arrive(5)
        sent = len(rig.navigation.goals)
        rig.step(0.5)
        assert len(rig.navigation.goals) == sent  # an e-stop may follow: no goal at once
        rig.step(1.0)
        assert rig.state == "INSPECTING.NAVIGATING"
    rig.arrive(5)
    assert rig.statuses() == [("1", UNREACHABLE, "nav_status_5")]


def test_navigation_that_restarts_gets_its_goal_again(make_rig):
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


def test_navigation_that_stays_away_uses_the_attempts_up(make_rig):
    rig = make_rig(nav_max_attempts=2, nav_timeout_s=5.0)
    rig.inspect("1")
    rig.navigation.ready = False
    rig.step(20.0)
    assert rig.statuses() == [("1", UNREACHABLE, "nav_unavailable")]


@pytest.mark.parametrize(("status", "error", "detail"), [(1, "no tag 1", "no tag 1"), (7, "", "bridge_status_7")])
def test_a_bridge_that_refuses_fails_the_scan(make_rig, status, error, detail):
    rig = make_rig(flower_scan_dwell_s=5.0)
    rig.greenhouse.status, rig.greenhouse.error = status, error
    rig.inspect("1")
    rig.arrive()
    rig.step()
    assert rig.statuses() == [("1", SCAN_FAILED, detail)]
    assert rig.snapshot.last_event == "scan failed"
    assert rig.snapshot.targets_failed == 1


def test_a_bridge_that_never_answers_times_out_and_a_late_answer_changes_nothing(make_rig):
    rig = make_rig(scan_timeout_s=2.0)
    rig.greenhouse.answers = False
    rig.inspect("1", "2")
    rig.arrive()
    rig.step(2.5)
    assert rig.statuses() == [("1", SCAN_FAILED, "scan_timeout")]
    rig.greenhouse.answer()
    rig.step()
    assert len(rig.outlet.records) == 1
    assert rig.state == "INSPECTING.NAVIGATING"


def test_the_dwell_counts_from_the_bridge_s_call(make_rig):
    rig = make_rig(flower_scan_dwell_s=4.0)
    rig.greenhouse.answers = False
    rig.inspect("1")
    rig.arrive()
    rig.step(3.0)
    rig.greenhouse.answer()
    rig.step(0.5)
    assert rig.state == "INSPECTING.SCANNING"
    rig.step(1.0)
    assert rig.statuses() == [("1", OK, "")]


def test_a_pause_in_the_dwell_holds_and_a_resume_does_not_read_again(make_rig):
    rig = make_rig(flower_scan_dwell_s=4.0)
    rig.inspect("1")
    rig.arrive()
    rig.step(1.0)
    rig.orchestrator.pause()
    rig.step(20.0)
    assert rig.state == "INSPECTING.SCANNING"
    rig.orchestrator.resume()
    assert rig.statuses() == [("1", OK, "")]
    assert rig.greenhouse.asked == ["1"]


# -- the visual gate ---------------------------------------------------------------------------------------------------


def test_the_gate_is_asked_before_the_bridge(make_rig):
    rig = make_rig(require_visual_confirmation=True)
    rig.gate.answers = False
    rig.inspect("1")
    rig.arrive()
    assert (rig.state, rig.snapshot.mission_phase) == ("INSPECTING.SCANNING", "CONFIRMING")
    assert rig.greenhouse.asked == []
    rig.gate.answer()
    rig.step(0.2)
    assert rig.greenhouse.asked == ["1"]
    assert rig.statuses() == [("1", OK, "")]


@pytest.mark.parametrize(("error", "detail"), [("stale", "stale"), ("", "visual_confirm_missed")])
def test_a_miss_of_the_gate_fails_the_scan(make_rig, error, detail):
    rig = make_rig(require_visual_confirmation=True)
    rig.gate.detected, rig.gate.error = False, error
    rig.inspect("1")
    rig.arrive()
    rig.step()
    assert rig.statuses() == [("1", SCAN_FAILED, detail)]


def test_a_silent_gate_times_out(make_rig):
    rig = make_rig(require_visual_confirmation=True, visual_confirmation_timeout_s=3.0)
    rig.gate.answers = False
    rig.inspect("1")
    rig.arrive()
    rig.step(3.5)
    assert rig.statuses() == [("1", SCAN_FAILED, "confirm_timeout")]


def test_an_answer_of_the_gate_while_paused_moves_nothing_and_is_kept(make_rig):
    rig = make_rig(require_visual_confirmation=True)
    rig.gate.answers = rig.gate.detected = False
    rig.inspect("1")
    rig.arrive()
    rig.orchestrator.pause()
    rig.gate.answer()
    rig.step()
    assert rig.state == "INSPECTING.SCANNING"
    rig.orchestrator.resume()
    assert rig.statuses() == [("1", SCAN_FAILED, "visual_confirm_missed")]


# -- the arm -----------------------------------------------------------------------------------------------------------


def test_the_arm_looks_into_each_pot_and_is_in_before_every_drive(make_rig):
    rig = make_rig(arm_patrol_enabled=True, arm_travel_settle_s=3.2, flower_scan_dwell_s=4.0)
    rig.inspect("1")
    assert rig.arm.struck[-1][0] == "home" and not rig.navigation.goals
    rig.step(3.5)
    rig.arrive()
    assert rig.arm.struck[-1][0] == "inspect"
    rig.step(4.5)
    assert rig.state == "RETURNING"
    assert rig.arm.struck[-1][0] == "home"
    assert len(rig.navigation.goals) == 1
    rig.step(3.5)
    assert len(rig.navigation.goals) == 2


def test_the_arm_is_left_alone_without_patrol(make_rig):
    rig = make_rig()
    rig.inspect("1")
    rig.arrive()
    assert rig.arm.struck == []


# -- exploration and monitoring ----------------------------------------------------------------------------------------


def test_exploring_drives_to_a_frontier_looking_the_way_it_drives(make_rig):
    rig = make_rig()
    rig.explore()
    (goal,) = rig.navigation.wanted
    assert goal.pose.x > 1.5
    assert goal.pose.yaw == pytest.approx(math.atan2(goal.pose.y, goal.pose.x))
    assert rig.snapshot.mission_type == "ExplorationMission"


def test_the_goal_of_tags_ends_the_exploration_and_starts_the_sweep(make_rig):
    rig = make_rig()
    rig.explore(2)
    rig.discover("1")
    rig.step()
    assert rig.state == "EXPLORING"
    rig.discover("1", "2")
    assert rig.state == "MONITORING.NAVIGATING"
    assert rig.navigation.goals[0].cancel_asked
    assert (rig.snapshot.mission_type, rig.snapshot.targets_total) == ("ExplorationMission", 2)
    assert rig.snapshot.tags_discovered == 2


def test_monitoring_goes_on_for_ever(make_rig):
    rig = make_rig()
    rig.monitor("1", "2")
    for _ in range(20):
        rig.arrive()
    assert rig.state == "MONITORING.NAVIGATING"
    monitored = [r for r in rig.outlet.records if r.source == "MonitoringMission"]
    assert [r.tag_id for r in monitored] == ["1", "2"] * 10


def test_monitoring_told_a_number_of_sweeps_comes_home(make_rig):
    rig = make_rig(monitoring_sweeps=2)
    rig.monitor("1", "2")
    for _ in range(4):
        assert rig.state == "MONITORING.NAVIGATING"
        rig.arrive()
    assert rig.state == "RETURNING"
    rig.arrive()
    assert rig.state == "DONE"
    assert rig.snapshot.mission_type == "ExplorationMission"


def test_a_sweep_starts_at_the_tag_nearest_to_the_robot(make_rig):
    rig = make_rig()
    rig.world.pose = Pose2(5.0, 1.0, 0.0)
    rig.explore(3)
    rig.discover("1", "2", "3")
    rig.step()
    assert rig.snapshot.current_target == "3"


def test_a_tag_seen_during_the_sweep_is_visited_too(make_rig):
    rig = make_rig(monitoring_sweeps=1)
    rig.monitor("1")
    rig.discover("1", "9")
    rig.arrive()
    assert rig.snapshot.current_target == "9"
    rig.arrive()
    assert rig.state == "RETURNING"


@pytest.mark.parametrize(("found", "state"), [(["1"], "MONITORING"), ([], "RETURNING")])
def test_exploring_has_a_time_limit(make_rig, found, state):
    rig = make_rig(exploration_timeout_s=30.0, nav_timeout_s=100.0)
    rig.explore(5)
    rig.discover(*found)
    rig.step(29.0)
    assert rig.state == "EXPLORING"
    rig.step(2.0)
    assert rig.snapshot.lifecycle_state == state
    assert rig.snapshot.last_event == "exploration timed out"


def test_time_spent_paused_is_not_spent_exploring(make_rig):
    rig = make_rig(exploration_timeout_s=30.0, nav_timeout_s=1000.0)
    rig.explore(5)
    rig.step(20.0)
    rig.orchestrator.pause()
    rig.step(60.0)
    rig.orchestrator.resume()
    rig.step(9.0)
    assert rig.state == "EXPLORING"
    rig.step(2.0)
    assert rig.state == "RETURNING"


@pytest.mark.parametrize(("found", "state"), [(["1"], "MONITORING"), ([], "RETURNING")])
def test_exploring_ends_when_nothing_is_left_to_look_at(make_rig, maps, found, state):
    rig = make_rig(exploration_exhausted_s=10.0)
    rig.show_map(maps.whole())
    rig.explore(65535)
    rig.discover(*found)
    rig.step(9.0)
    assert rig.state == "EXPLORING"
    rig.step(4.0)
    assert rig.snapshot.lifecycle_state == state
    assert rig.snapshot.last_error == ""


def test_all_tags_is_never_reached_by_a_count(make_rig):
    rig = make_rig()
    rig.explore(65535)
    rig.discover(*map(str, range(40)))
    rig.step()
    assert rig.state == "EXPLORING"
    assert (rig.snapshot.discovery_goal, rig.snapshot.targets_total) == (65535, 40)


def test_an_unmet_goal_is_said_when_nothing_is_left(make_rig, maps):
    rig = make_rig()
    rig.show_map(maps.whole())
    rig.explore(5)
    rig.step(15.0)
    assert rig.snapshot.last_error == "exploration_exhausted: 0 of 5 tags"


def test_without_a_map_exploring_waits_instead_of_ending(make_rig):
    rig = make_rig(exploration_timeout_s=100.0)
    rig.show_map()
    rig.explore(5)
    rig.world.newest = None
    rig.step(50.0)
    assert rig.state == "EXPLORING"


def test_a_frontier_that_takes_too_long_is_given_up_for_another_choice(make_rig):
    rig = make_rig(nav_timeout_s=10.0)
    rig.explore()
    rig.step(10.5)
    assert rig.navigation.goals[0].cancel_asked
    rig.step(2.0)
    assert len(rig.navigation.goals) == 2


def test_rejected_frontiers_are_chosen_at_most_once_a_second_and_not_for_ever(make_rig):
    rig = make_rig(exploration_timeout_s=1000.0)
    rig.navigation.answers = False
    rig.explore()
    started = rig.clock.s
    while rig.state == "EXPLORING":
        for goal in rig.navigation.wanted:
            rig.navigation.reject(goal)
        rig.step()
        assert len(rig.navigation.goals) <= rig.clock.s - started + 2
    assert rig.clock.s - started < 60.0
    assert rig.state == "RETURNING"


def test_a_frontier_that_is_no_longer_one_is_left_for_the_next(make_rig, maps):
    rig = make_rig(exploration_exhausted_s=5.0)
    rig.explore()
    rig.show_map(maps.whole())
    rig.step(1.5)
    assert rig.navigation.goals[0].cancel_asked
    assert not rig.navigation.wanted


def test_each_discovered_tag_is_read_once_while_exploring(make_rig):
    rig = make_rig()
    rig.explore(5)
    rig.discover("1")
    rig.discover("1")
    rig.discover("1", "2")
    assert rig.greenhouse.asked == ["1", "2"]
    assert [(r.tag_id, r.status, r.source, r.detail) for r in rig.outlet.records] == [
        ("1", OK, "ExplorationMission", ""),
        ("2", OK, "ExplorationMission", ""),
    ]
    assert (rig.last.pose.x, rig.last.pose.y) == (3.0, 1.0)
    assert rig.state == "EXPLORING"


def test_seeding_can_be_off_waits_for_nobody_and_says_nothing_of_failures(make_rig):
    rig = make_rig(seed_climate_on_discovery=False)
    rig.explore(5)
    rig.discover("1")
    assert rig.greenhouse.asked == []
    rig = make_rig()
    rig.greenhouse.answers = False
    rig.greenhouse.status = 1
    rig.explore(5)
    rig.discover("1")
    rig.step(30.0)
    rig.greenhouse.answer()
    assert rig.outlet.records == []


def test_a_perception_that_restarts_with_an_empty_list_loses_no_tag(make_rig):
    rig = make_rig()
    rig.explore(5)
    rig.discover("1", "2")
    rig.discover()
    assert rig.snapshot.tags_discovered == 2


def test_tags_without_finite_poses_are_not_believed(make_rig):
    from lupin_runtime.mission.approach import TagPose

    rig = make_rig()
    rig.explore(1)
    rig.orchestrator.heard_tags({"1": TagPose(math.nan, 0.0), "": TagPose(1.0, 0.0)})
    rig.step()
    assert rig.state == "EXPLORING"


# -- coming home -------------------------------------------------------------------------------------------------------


def _into(rig, state):
    """Bring a rig into a leaf state."""
    if state == "PREPARE.LOCALIZING":
        rig.localize(9.0)
        rig.inspect("1", "2")
    elif state == "EXPLORING":
        rig.explore(5)
    elif state == "RETURNING":
        rig.inspect("1")
        rig.arrive()
    elif state.startswith("INSPECTING"):
        rig.inspect("1", "2")
    elif state.startswith("MONITORING"):
        rig.monitor("1", "2")
    if state.endswith("SCANNING"):
        rig.greenhouse.answers = False
        rig.arrive()
    elif state.endswith("PUBLISHING"):
        rig.greenhouse.answers = False
        rig.arrive()
        rig.orchestrator.pause()
        rig.orchestrator._visiting._close(OK, "")
    assert rig.state == state


MOVING = ["EXPLORING", "INSPECTING.NAVIGATING", "MONITORING.NAVIGATING", "RETURNING"]
DIVERTIBLE = [
    "EXPLORING",
    *(f"{f}.{leaf}" for f in ("INSPECTING", "MONITORING") for leaf in ("NAVIGATING", "SCANNING", "PUBLISHING")),
]
BUSY_STATES = ["PREPARE.LOCALIZING", *DIVERTIBLE, "RETURNING"]


@pytest.mark.parametrize("state", DIVERTIBLE)
def test_a_dock_request_comes_back_to_what_it_left(make_rig, state):
    rig = make_rig()
    _into(rig, state)
    assert rig.orchestrator.dock().success
    assert rig.state == "RETURNING"
    if rig.snapshot.paused:  # held where it was
        assert not rig.navigation.wanted
        assert rig.orchestrator.resume().success
    rig.step()
    assert rig.navigation.wanted[0].pose == Pose2()
    rig.arrive()
    rig.step(5.0)
    assert rig.state == "RETURNING"
    assert rig.snapshot.paused
    assert rig.orchestrator.resume().success
    rig.greenhouse.answers = True
    rig.step(2.0)
    assert rig.snapshot.lifecycle_state == state.split(".")[0]
    assert len(rig.navigation.wanted) == 1


@pytest.mark.parametrize("state", DIVERTIBLE)
def test_a_low_battery_drives_home_and_comes_back_to_what_was_left(make_rig, state):
    rig = make_rig()
    _into(rig, state)
    paused = rig.snapshot.paused
    rig.orchestrator.heard_battery(19.0)  # a source that counts in percent
    assert rig.state == "RETURNING"
    assert rig.snapshot.last_event == "battery low"
    if paused:
        rig.step(5.0)
        assert not rig.navigation.wanted  # a robot that a person has stopped stays stopped
        assert rig.orchestrator.resume().success
    else:
        assert "battery" in rig.orchestrator.pause().message
        assert not rig.orchestrator.abort().success
    rig.step()
    rig.arrive()
    assert rig.snapshot.paused
    assert "battery" in rig.orchestrator.resume().message
    rig.orchestrator.heard_battery(0.9)
    rig.step(5.0)
    assert rig.state == "RETURNING"
    assert rig.orchestrator.resume().success
    rig.greenhouse.answers = True
    rig.step(2.0)
    assert rig.snapshot.lifecycle_state == state.split(".")[0]


def test_a_tag_that_is_published_before_a_diversion_is_not_published_again(make_rig):
    rig = make_rig()
    _into(rig, "INSPECTING.PUBLISHING")
    rig.orchestrator.dock()
    rig.orchestrator.resume()
    rig.greenhouse.answers = True
    rig.arrive()
    rig.orchestrator.resume()
    assert rig.snapshot.current_target == "2"
    rig.arrive()
    assert [tag for tag, _, _ in rig.statuses()] == ["1", "2"]


def test_a_diversion_after_the_last_tag_ends_the_inspection_on_resume(make_rig):
    rig = make_rig()
    rig.inspect("1")
    rig.greenhouse.answers = False
    rig.arrive()
    rig.orchestrator.pause()
    rig.orchestrator._visiting._close(OK, "")
    rig.orchestrator.dock()
    rig.orchestrator.resume()
    rig.arrive()
    rig.orchestrator.resume()
    assert rig.state == "RETURNING"
    rig.arrive()
    assert rig.state == "DONE"
    assert rig.statuses() == [("1", OK, "")]
    assert rig.orchestrator.hsm.ignored == []


@pytest.mark.parametrize("state", ["PREPARE.LOCALIZING", *DIVERTIBLE])
def test_an_abort_drives_home_and_ends(make_rig, state):
    rig = make_rig()
    _into(rig, state)
    assert rig.orchestrator.abort().success
    assert rig.state == "RETURNING"
    if rig.snapshot.paused:
        rig.orchestrator.resume()
    rig.arrive()
    assert rig.state == "DONE"
    assert not rig.snapshot.paused
    if state == "PREPARE.LOCALIZING":
        assert rig.snapshot.last_event == "aborted during prepare"


def test_an_aborted_inspection_closes_each_tag_that_is_left(make_rig):
    rig = make_rig()
    rig.inspect("0", "1", "2")
    rig.arrive()
    rig.orchestrator.abort()
    assert rig.statuses() == [("0", OK, ""), ("1", SKIPPED, "mission_aborted"), ("2", SKIPPED, "mission_aborted")]
    assert (rig.snapshot.targets_completed, rig.snapshot.targets_skipped) == (1, 2)
    assert rig.orchestrator.abort().success
    assert rig.state == "DONE"
    assert len(rig.outlet.records) == 3
    assert not rig.navigation.wanted


@pytest.mark.parametrize("state", DIVERTIBLE)
def test_an_abort_at_the_dock_ends_at_once(make_rig, state):
    rig = make_rig()
    _into(rig, state)
    rig.orchestrator.dock()
    if rig.snapshot.paused:
        rig.orchestrator.resume()
    rig.arrive()
    assert rig.orchestrator.abort().success
    assert rig.state == "DONE"
    skipped = [tag for tag, status, _ in rig.statuses() if status == SKIPPED]
    assert bool(skipped) == state.startswith("INSPECTING")


@pytest.mark.parametrize("low", [False, True])
def test_a_dock_that_cannot_be_reached_ends_a_mission_but_not_a_battery_return(make_rig, low):
    rig = make_rig(dock_retry_max=3)
    rig.inspect("1", "2")
    if low:
        rig.orchestrator.heard_battery(0.1)
    else:
        rig.orchestrator.abort()
    sent = len(rig.navigation.goals) - 1
    for _ in range(4 if low else 1):
        rig.fail()
        rig.step(2.0)
    assert len(rig.navigation.goals) - sent == (4 if low else 1)
    if not low:
        assert rig.state == "DONE"
        return
    assert rig.state == "RETURNING"
    assert rig.snapshot.paused
    assert rig.snapshot.last_event == "dock unreachable — paused"
    assert not rig.navigation.wanted


def test_after_an_unreachable_dock_the_operator_may_send_it_again_or_charge_and_go_on(make_rig):
    rig = make_rig(dock_retry_max=0)
    rig.explore(5)
    rig.orchestrator.heard_battery(0.1)
    rig.fail()
    assert rig.snapshot.paused
    assert rig.orchestrator.resume().success
    rig.fail()
    rig.orchestrator.heard_battery(0.8)
    assert rig.orchestrator.resume().success
    assert rig.state == "EXPLORING"


def test_the_dock_has_a_time_limit(make_rig):
    rig = make_rig(dock_timeout_s=20.0)
    rig.inspect("1")
    rig.orchestrator.abort()
    rig.step(20.5)
    assert rig.state == "DONE"
    assert not rig.navigation.wanted


def test_a_stale_cancel_of_the_dock_goal_is_answered_once(make_rig):
    rig = make_rig()
    rig.inspect("1")
    rig.orchestrator.abort()
    rig.arrive(5)
    rig.step(2.0)
    assert rig.state == "RETURNING"
    rig.arrive(5)
    assert rig.state == "DONE"


def test_a_cancel_whose_end_is_never_heard_does_not_strand_the_return(make_rig):
    rig = make_rig()
    rig.navigation.acknowledges = False
    rig.inspect("1")
    rig.orchestrator.abort()
    rig.step(2.5)
    assert len(rig.navigation.goals) == 1
    rig.step(1.0)
    assert len(rig.navigation.goals) == 2
    rig.arrive()
    assert rig.state == "DONE"


def test_navigation_that_is_gone_does_not_strand_the_return(make_rig):
    rig = make_rig(dock_timeout_s=10.0)
    rig.inspect("1")
    rig.navigation.ready = False
    rig.orchestrator.abort()
    rig.step(15.0)
    assert rig.state == "DONE"


# -- flags -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("state", BUSY_STATES)
def test_an_e_stop_stops_and_only_a_resume_goes_on(make_rig, state):
    rig = make_rig()
    _into(rig, state)
    rig.orchestrator.heard_estop(True)
    assert not rig.navigation.wanted
    rig.localize()
    rig.step(5.0)
    assert rig.snapshot.estop_engaged and rig.snapshot.paused
    assert rig.snapshot.last_event == "e-stop engaged"
    assert "e-stop" in rig.orchestrator.resume().message
    sent = len(rig.navigation.goals)
    for _ in range(10):
        rig.orchestrator.heard_estop(False)
        rig.step()
    assert rig.state == state
    assert rig.snapshot.paused and not rig.snapshot.estop_engaged
    assert len(rig.navigation.goals) == sent
    assert rig.orchestrator.resume().success
    rig.greenhouse.answers = True
    rig.step(7.0)
    assert len(rig.navigation.goals) > sent


@pytest.mark.parametrize("state", ["READY", "DONE", "FAULT", "BOOT"])
def test_an_e_stop_while_idle_starts_nothing_on_release(make_rig, state):
    rig = make_rig(booted=state != "BOOT", dependency_timeout_s=1.0)
    if state == "DONE":
        rig.inspect("1")
        rig.orchestrator.abort()
        rig.orchestrator.abort()
    elif state == "FAULT":
        rig = make_rig(booted=False, dependency_timeout_s=1.0)
        rig.navigation.ready = False
        rig.step(2.0)
    assert rig.state == state
    sent = len(rig.navigation.goals)
    rig.orchestrator.heard_estop(True)
    rig.orchestrator.heard_estop(False)
    rig.step(3.0)
    assert rig.state in (state, "READY")
    assert len(rig.navigation.goals) == sent


def test_an_e_stop_while_paused_still_needs_a_resume_after_its_release(make_rig):
    rig = make_rig()
    rig.inspect("1")
    rig.orchestrator.pause()
    rig.orchestrator.heard_estop(True)
    rig.orchestrator.heard_estop(False)
    rig.step(1.0)
    assert rig.snapshot.paused
    assert not rig.navigation.wanted


def test_an_e_stop_catches_a_goal_that_is_not_accepted_yet(make_rig):
    rig = make_rig()
    rig.navigation.answers = False
    rig.inspect("1")
    rig.orchestrator.heard_estop(True)
    rig.navigation.accept(rig.navigation.goals[0])
    assert not rig.navigation.wanted


def test_an_e_stop_catches_a_goal_that_waits_for_a_cancel(make_rig):
    rig = make_rig()
    rig.navigation.acknowledges = False
    rig.inspect("1")
    rig.orchestrator.abort()
    rig.orchestrator.heard_estop(True)
    rig.step(10.0)
    assert len(rig.navigation.goals) == 1


def test_an_e_stop_while_the_arm_settles_sends_no_goal(make_rig):
    rig = make_rig(arm_patrol_enabled=True, arm_travel_settle_s=3.0)
    rig.inspect("1")
    rig.orchestrator.heard_estop(True)
    struck = len(rig.arm.struck)
    rig.step(10.0)
    assert not rig.navigation.goals
    assert len(rig.arm.struck) == struck


@pytest.mark.parametrize("state", MOVING)
def test_a_pause_cancels_the_goal_and_a_resume_sends_it_again(make_rig, state):
    rig = make_rig(nav_max_attempts=1)
    _into(rig, state)
    (goal,) = rig.navigation.wanted
    assert rig.orchestrator.pause().success
    assert not rig.navigation.wanted
    assert "already paused" in rig.orchestrator.pause().message
    rig.step(90.0)
    assert rig.state == state
    assert rig.orchestrator.resume().success
    rig.step(1.5)
    (again,) = rig.navigation.wanted
    assert again.pose == goal.pose


def test_a_pause_refunds_the_attempt(make_rig):
    rig = make_rig(nav_max_attempts=1)
    rig.inspect("1")
    for _ in range(5):
        rig.orchestrator.pause()
        rig.orchestrator.resume()
    rig.arrive()
    assert rig.statuses() == [("1", OK, "")]


@pytest.mark.parametrize("request_name", ["pause", "abort", "skip_current", "dock", "reset", "resume"])
@pytest.mark.parametrize("state", ["READY", "BOOT", "DONE"])
def test_requests_that_make_no_sense_are_refused_with_a_reason(make_rig, state, request_name):
    rig = make_rig(booted=state != "BOOT")
    if state == "DONE":
        rig.inspect("1")
        rig.orchestrator.abort()
        rig.orchestrator.abort()
    reply = getattr(rig.orchestrator, request_name)()
    assert not reply.success
    assert reply.message
    assert rig.state == state


@pytest.mark.parametrize("state", ["PREPARE.LOCALIZING", "RETURNING"])
def test_docking_is_refused_where_there_is_nothing_to_come_back_to(make_rig, state):
    rig = make_rig()
    _into(rig, state)
    assert not rig.orchestrator.dock().success


@pytest.mark.parametrize("state", ["EXPLORING", "MONITORING.NAVIGATING", "RETURNING", "PREPARE.LOCALIZING"])
def test_only_an_inspection_skips(make_rig, state):
    rig = make_rig()
    _into(rig, state)
    assert not rig.orchestrator.skip_current().success
    assert rig.state == state


@pytest.mark.parametrize("state", ["INSPECTING.NAVIGATING", "INSPECTING.SCANNING"])
def test_skipping_closes_the_tag_and_moves_on(make_rig, state):
    rig = make_rig()
    _into(rig, state)
    assert rig.orchestrator.skip_current().success
    assert rig.statuses() == [("1", SKIPPED, "skipped_by_operator")]
    assert (rig.state, rig.snapshot.current_target) == ("INSPECTING.NAVIGATING", "2")
    assert len(rig.navigation.wanted) == 1


def test_skipping_while_paused_closes_the_tag_and_drives_nowhere(make_rig):
    rig = make_rig()
    rig.inspect("1", "2")
    rig.orchestrator.pause()
    assert rig.orchestrator.skip_current().success
    assert rig.statuses() == [("1", SKIPPED, "skipped_by_operator")]
    rig.step(5.0)
    assert not rig.navigation.wanted
    assert not rig.orchestrator.skip_current().success
    rig.orchestrator.resume()
    assert rig.snapshot.current_target == "2"


@pytest.mark.parametrize("state", ["READY", "DONE", "PREPARE.LOCALIZING"])
def test_a_low_battery_before_the_drive_only_pauses(make_rig, state):
    rig = make_rig()
    if state == "PREPARE.LOCALIZING":
        _into(rig, state)
    elif state == "DONE":
        rig.inspect("1")
        rig.orchestrator.abort()
        rig.orchestrator.abort()
    rig.orchestrator.heard_battery(0.19)
    rig.localize()
    rig.step(2.0)
    assert rig.state == state
    assert rig.snapshot.paused and rig.snapshot.battery_low
    assert not rig.orchestrator.start("InspectionMission", ["1"]).success
    rig.orchestrator.heard_battery(0.20)
    rig.step(2.0)
    assert rig.state == state
    assert rig.snapshot.paused and not rig.snapshot.battery_low


def test_a_low_battery_on_the_way_home_lets_the_robot_come_home(make_rig):
    rig = make_rig()
    rig.inspect("1")
    rig.arrive()
    rig.orchestrator.heard_battery(0.1)
    rig.step()
    rig.arrive()
    assert rig.state == "DONE"


def test_an_e_stop_on_the_way_to_the_charger_does_not_strand_the_robot(make_rig):
    rig = make_rig()
    rig.inspect("1")
    rig.orchestrator.heard_battery(0.1)
    rig.orchestrator.heard_estop(True)
    rig.orchestrator.heard_estop(False)
    rig.step(5.0)
    assert not rig.navigation.wanted
    assert rig.orchestrator.resume().success
    rig.arrive()
    assert rig.state == "RETURNING"
    assert rig.snapshot.paused


def test_a_reset_does_not_forget_what_the_monitors_still_say(make_rig):
    rig = make_rig(booted=False, dependency_timeout_s=1.0)
    rig.navigation.ready = False
    rig.orchestrator.heard_battery(0.1)
    rig.orchestrator.heard_estop(True)
    rig.step(2.0)
    assert rig.state == "FAULT"
    rig.navigation.ready = True
    assert rig.orchestrator.reset().success
    assert rig.snapshot.battery_low and rig.snapshot.estop_engaged
    assert "e-stop" in rig.orchestrator.start("InspectionMission", ["1"]).message
    rig.orchestrator.heard_estop(False)
    assert "battery" in rig.orchestrator.start("InspectionMission", ["1"]).message
    rig.orchestrator.heard_battery(0.5)
    rig.localize()
    assert rig.orchestrator.start("InspectionMission", ["1"]).success


@pytest.mark.parametrize("value", [math.nan, math.inf, -1.0])
def test_a_battery_that_says_nothing_is_not_low(make_rig, value):
    rig = make_rig()
    rig.orchestrator.heard_battery(value)
    assert not rig.snapshot.battery_low


def test_the_end_of_the_process_leaves_no_goal_behind(make_rig):
    rig = make_rig()
    rig.inspect("1")
    rig.orchestrator.shut_down()
    assert not rig.navigation.wanted


def test_a_new_mission_starts_with_clean_counters(make_rig):
    rig = make_rig()
    rig.inspect("1")
    first = rig.snapshot
    rig.orchestrator.abort()
    rig.orchestrator.abort()
    rig.inspect("2")
    assert rig.snapshot.mission_id != first.mission_id
    assert rig.snapshot.targets_skipped == 0
    assert rig.snapshot.last_error == ""
    assert rig.snapshot.started_at_ns > first.started_at_ns


def test_an_inspection_that_ends_on_its_way_to_an_unreachable_dock_closes_its_tags(make_rig):
    rig = make_rig()
    rig.inspect("1", "2")
    rig.orchestrator.dock()
    rig.fail()
    assert rig.state == "DONE"
    assert rig.statuses() == [("1", SKIPPED, "mission_aborted"), ("2", SKIPPED, "mission_aborted")]
