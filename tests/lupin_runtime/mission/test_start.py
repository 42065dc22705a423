"""BOOT, start requests and localization."""

from __future__ import annotations

import math

import pytest

from lupin_runtime.geometry import Pose2
from lupin_runtime.layout import Layout
from lupin_runtime.mission.dependencies import CANCEL_ANSWER_WAIT_S
from tests.support.mission_rig import Rig


def test_boot_waits_for_servers_then_cancels_old_goals(make_rig: type[Rig]) -> None:
    rig = make_rig(ready=False)
    rig.navigation.ready = False
    rig.step(5.0)
    assert rig.state == "BOOT"
    rig.navigation.ready = True
    rig.step()
    assert rig.state == "READY"
    assert rig.navigation.cancel_all_count == 1


def test_boot_waits_for_the_cancels_answer_within_a_bound(make_rig: type[Rig]) -> None:
    rig = make_rig(ready=False)
    rig.navigation.answers_cancels = False
    rig.step(CANCEL_ANSWER_WAIT_S / 2)
    assert (rig.state, rig.navigation.cancel_all_count) == ("BOOT", 1)
    rig.step(CANCEL_ANSWER_WAIT_S)
    assert (rig.state, rig.navigation.cancel_all_count) == ("READY", 1)


@pytest.mark.parametrize("required", [False, True])
def test_boot_waits_for_confirmation_service_only_if_required(make_rig: type[Rig], required: bool) -> None:
    rig = make_rig(ready=False, require_visual_confirmation=required)
    rig.confirmer.ready = False
    rig.step()
    assert rig.state == ("BOOT" if required else "READY")


def test_missing_dependencies_cause_fault_until_reset(make_rig: type[Rig]) -> None:
    rig = make_rig(ready=False, dependency_timeout_s=3.0)
    rig.climate_bridge.ready = False
    rig.step(3.5)
    assert rig.state == "FAULT"
    assert rig.snapshot.last_event == "dependencies not ready"
    assert "get_tag_reading" in rig.publisher.lines[-2]
    assert not rig.requests.start().success
    assert rig.requests.reset().success
    assert rig.state == "READY"
    assert rig.snapshot.last_error == ""


def test_boot_completes_while_e_stop_is_engaged(make_rig: type[Rig]) -> None:
    rig = make_rig(ready=False)
    rig.orchestrator.on_estop(True)
    rig.step()
    assert rig.state == "READY"


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("GardeningMission", [], 0), "unknown mission type"),
        (("InspectionMission", ["1", "99"], 0), "unknown tag ids: '99'"),
        (("ExplorationMission", [], -1), "discovery goal"),
    ],
)
def test_start_with_invalid_arguments_is_refused(
    make_rig: type[Rig], arguments: tuple[str, list[str], int], expected: str
) -> None:
    rig = make_rig()
    reply = rig.requests.start(*arguments)
    assert not reply.success
    assert expected in reply.message
    assert rig.state == "READY"
    assert rig.snapshot.mission_id == ""


def test_start_without_known_tags_is_refused(make_rig: type[Rig]) -> None:
    assert "empty" in make_rig(layout=Layout()).requests.start().message


def test_discovery_goal_of_zero_uses_the_parameter(make_rig: type[Rig]) -> None:
    assert not make_rig(discovery_goal=0).requests.start("ExplorationMission").success
    rig = make_rig(discovery_goal=3)
    assert rig.requests.start("ExplorationMission").success
    assert rig.snapshot.discovery_goal == 3


def test_start_in_boot_names_missing_servers(make_rig: type[Rig]) -> None:
    rig = make_rig(ready=False)
    rig.climate_bridge.ready = False
    assert "/greenhouse_bridge/get_tag_reading" in rig.requests.start().message


def test_second_start_is_refused(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.inspect("1")
    assert "mission already running" in rig.requests.start().message


@pytest.mark.parametrize("state", ["READY", "DONE"])
def test_start_while_e_stopped_is_refused(make_rig: type[Rig], state: str) -> None:
    rig = make_rig()
    if state == "DONE":
        rig.inspect("1")
        rig.end_mission()
    assert rig.state == state
    sent = len(rig.navigation.goals)
    rig.orchestrator.on_estop(True)
    reply = rig.requests.start("InspectionMission", ["1"])
    assert not reply.success
    assert "e-stop" in reply.message
    rig.orchestrator.on_estop(False)
    rig.step(5.0)
    assert rig.state == state
    assert len(rig.navigation.goals) == sent


def test_inspection_tags_fall_back_to_parameter_then_all_known(make_rig: type[Rig]) -> None:
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


def test_prepare_waits_for_small_pose_variance(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.localize(0.3)
    rig.inspect("1")
    assert (rig.state, rig.snapshot.mission_phase) == ("PREPARE.LOCALIZING", "LOCALIZING")
    rig.localize(0.25)
    rig.step()
    assert rig.state == "INSPECTING.NAVIGATING"


@pytest.mark.parametrize("variance", [0.3, math.nan])
def test_prepare_without_localization_ends_in_fault(make_rig: type[Rig], variance: float) -> None:
    rig = make_rig(localization_timeout_s=4.0)
    rig.localize(variance)
    rig.inspect("1")
    rig.step(5.0)
    assert rig.state == "FAULT"
    assert rig.snapshot.last_error == "localization_failed"
    assert not rig.navigation.goals


def test_localization_timeout_excludes_pauses(make_rig: type[Rig]) -> None:
    rig = make_rig(localization_timeout_s=4.0)
    rig.localize(9.0)
    rig.inspect("1")
    rig.requests.pause()
    rig.step(60.0)
    assert rig.state == "PREPARE.LOCALIZING"
    rig.requests.resume()
    rig.step(3.0)
    assert rig.state == "PREPARE.LOCALIZING"
    rig.step(2.0)
    assert rig.state == "FAULT"


def test_dock_is_position_of_first_start(make_rig: type[Rig]) -> None:
    rig = make_rig(dock_pose=(0.0, 0.0, 1.5))
    rig.map_source.pose = Pose2(3.0, 4.0, 0.2)
    for _ in range(2):
        rig.inspect("1")
        rig.requests.abort()
        assert rig.navigation.goals[-1].pose == Pose2(3.0, 4.0, 1.5)
        rig.arrive()
        assert rig.state == "DONE"
        rig.map_source.pose = Pose2(-1.0, 0.0, 0.0)


def test_dock_is_parameter_or_origin_without_transform(make_rig: type[Rig]) -> None:
    rig = make_rig(dock_pose=(1.0, 2.0, 0.5))
    rig.map_source.pose = Pose2(3.0, 4.0, 0.2)
    rig.inspect("1")
    rig.requests.abort()
    assert rig.navigation.goals[-1].pose == Pose2(1.0, 2.0, 0.5)
    rig = make_rig()
    rig.map_source.pose = None
    rig.inspect("1")
    rig.requests.abort()
    assert rig.navigation.goals[-1].pose == Pose2()
