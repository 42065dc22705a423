"""Returning to the dock: after the last tag, on request, with a low battery, after an abort."""

from __future__ import annotations

import pytest

from lupin_runtime.geometry import Pose2
from lupin_runtime.mission.missions import OK, SKIPPED
from tests.support.mission_rig import Rig
from tests.support.mission_states import RESUMABLE_LEAVES


@pytest.mark.parametrize("state", RESUMABLE_LEAVES)
def test_resume_after_dock_request_continues_interrupted_state(make_rig: type[Rig], state: str) -> None:
    rig = make_rig()
    rig.bring_to(state)
    assert rig.requests.dock().success
    assert rig.state == "RETURNING"
    if rig.snapshot.paused:  # held where it was
        assert not rig.navigation.driving
        assert rig.requests.resume().success
    rig.step()
    assert rig.navigation.driving[0].pose == Pose2()
    rig.arrive()
    rig.step(5.0)
    assert rig.state == "RETURNING"
    assert rig.snapshot.paused
    assert rig.requests.resume().success
    rig.climate_bridge.replies = True
    rig.step(2.0)
    assert rig.snapshot.lifecycle_state == state.split(".")[0]
    assert len(rig.navigation.driving) == 1


@pytest.mark.parametrize("state", RESUMABLE_LEAVES)
def test_low_battery_docks_and_resumes_interrupted_state(make_rig: type[Rig], state: str) -> None:
    rig = make_rig()
    rig.bring_to(state)
    paused = rig.snapshot.paused
    rig.orchestrator.on_battery(19.0)  # a source that counts in percent
    assert rig.state == "RETURNING"
    assert rig.snapshot.last_event == "battery low"
    if paused:
        rig.step(5.0)
        assert not rig.navigation.driving  # a robot that a person has stopped stays stopped
        assert rig.requests.resume().success
    else:
        assert "battery" in rig.requests.pause().message
        assert not rig.requests.abort().success
    rig.step()
    rig.arrive()
    assert rig.snapshot.paused
    assert "battery" in rig.requests.resume().message
    rig.orchestrator.on_battery(0.9)
    rig.step(5.0)
    assert rig.state == "RETURNING"
    assert rig.requests.resume().success
    rig.climate_bridge.replies = True
    rig.step(2.0)
    assert rig.snapshot.lifecycle_state == state.split(".")[0]


def test_tag_published_before_docking_is_not_published_again(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.bring_to("INSPECTING.PUBLISHING")
    rig.requests.dock()
    rig.requests.resume()
    rig.climate_bridge.replies = True
    rig.arrive()
    rig.requests.resume()
    assert rig.snapshot.current_target == "2"
    rig.arrive()
    assert [tag for tag, _, _ in rig.statuses()] == ["1", "2"]


def test_resume_after_docking_at_last_tag_ends_inspection(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.inspect("1")
    rig.climate_bridge.replies = False
    rig.arrive()
    rig.pause_in_publishing()
    rig.requests.dock()
    rig.requests.resume()
    rig.arrive()
    rig.requests.resume()
    assert rig.state == "RETURNING"
    rig.arrive()
    assert rig.state == "DONE"
    assert rig.statuses() == [("1", OK, "")]
    assert rig.orchestrator.hsm.ignored == []


@pytest.mark.parametrize("state", ["PREPARE.LOCALIZING", *RESUMABLE_LEAVES])
def test_abort_returns_to_dock_and_ends(make_rig: type[Rig], state: str) -> None:
    rig = make_rig()
    rig.bring_to(state)
    assert rig.requests.abort().success
    assert rig.state == "RETURNING"
    if rig.snapshot.paused:
        rig.requests.resume()
    rig.arrive()
    assert rig.state == "DONE"
    assert not rig.snapshot.paused
    if state == "PREPARE.LOCALIZING":
        assert rig.snapshot.last_event == "aborted during prepare"


def test_aborted_inspection_skips_remaining_tags(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.inspect("0", "1", "2")
    rig.arrive()
    rig.requests.abort()
    assert rig.statuses() == [("0", OK, ""), ("1", SKIPPED, "mission_aborted"), ("2", SKIPPED, "mission_aborted")]
    assert (rig.snapshot.targets_completed, rig.snapshot.targets_skipped) == (1, 2)
    assert rig.requests.abort().success
    assert rig.state == "DONE"
    assert len(rig.publisher.records) == 3
    assert not rig.navigation.driving


@pytest.mark.parametrize("state", RESUMABLE_LEAVES)
def test_abort_at_dock_ends_at_once(make_rig: type[Rig], state: str) -> None:
    rig = make_rig()
    rig.bring_to(state)
    rig.requests.dock()
    if rig.snapshot.paused:
        rig.requests.resume()
    rig.arrive()
    assert rig.requests.abort().success
    assert rig.state == "DONE"
    details = {detail for _, status, detail in rig.statuses() if status == SKIPPED}
    assert details == ({"mission_aborted"} if state.startswith("INSPECTING") else set())


@pytest.mark.parametrize("low", [False, True])
def test_unreachable_dock_ends_abort_but_retries_low_battery(make_rig: type[Rig], low: bool) -> None:
    rig = make_rig(dock_retry_max=3)
    rig.inspect("1", "2")
    if low:
        rig.orchestrator.on_battery(0.1)
    else:
        rig.requests.abort()
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
    assert not rig.navigation.driving


def test_resume_after_unreachable_dock_retries_or_continues(make_rig: type[Rig]) -> None:
    rig = make_rig(dock_retry_max=0)
    rig.explore(5)
    rig.orchestrator.on_battery(0.1)
    rig.fail()
    assert rig.snapshot.paused
    assert rig.requests.resume().success
    rig.fail()
    rig.orchestrator.on_battery(0.8)
    assert rig.requests.resume().success
    assert rig.state == "EXPLORING"


def test_docking_ends_at_its_timeout(make_rig: type[Rig]) -> None:
    rig = make_rig(dock_timeout_s=20.0)
    rig.inspect("1")
    rig.requests.abort()
    rig.step(20.5)
    assert rig.state == "DONE"
    assert not rig.navigation.driving


def test_stale_cancel_of_dock_goal_is_retried_once(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.inspect("1")
    rig.requests.abort()
    rig.end_drive(5)
    rig.step(2.0)
    assert rig.state == "RETURNING"
    rig.end_drive(5)
    assert rig.state == "DONE"


def test_lost_cancel_result_does_not_block_docking(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.navigation.answers_cancels = False
    rig.inspect("1")
    rig.requests.abort()
    rig.step(2.5)
    assert len(rig.navigation.goals) == 1
    rig.step(1.0)
    assert len(rig.navigation.goals) == 2
    rig.arrive()
    assert rig.state == "DONE"


def test_missing_navigation_ends_docking_at_timeout(make_rig: type[Rig]) -> None:
    rig = make_rig(dock_timeout_s=10.0)
    rig.inspect("1")
    rig.navigation.ready = False
    rig.requests.abort()
    rig.step(15.0)
    assert rig.state == "DONE"
