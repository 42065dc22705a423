"""A robot that is lost on its map stops, goes on once it is found, and otherwise ends its mission with that reason."""

from __future__ import annotations

import pytest

from lupin_runtime.localization import LOST_YAW_VARIANCE
from lupin_runtime.mission.events import ERROR, INFO, WARN
from lupin_runtime.mission.missions import OK
from lupin_runtime.mission.records import MapPose
from tests.support.mission_rig import Rig

DRIVING = ["EXPLORING", "INSPECTING.NAVIGATING", "MONITORING.NAVIGATING", "RETURNING"]


def lose(rig: Rig) -> None:
    rig.orchestrator.on_pose(MapPose(0.0, 0.0), (8.0, 5.0, LOST_YAW_VARIANCE))


@pytest.mark.parametrize("state", DRIVING)
def test_lost_robot_stops_and_goes_on_once_it_is_found(make_rig: type[Rig], state: str) -> None:
    rig = make_rig(localization_timeout_s=15.0)
    rig.bring_to(state)
    rig.step(1.0)
    assert rig.navigation.driving
    lose(rig)
    rig.step()
    assert not rig.navigation.driving and (rig.snapshot.last_error, rig.snapshot.last_event_severity) == ("robot_lost", WARN)
    rig.step(10.0)
    assert not rig.navigation.driving and rig.state == state
    rig.localize()
    rig.step()
    assert (rig.snapshot.last_error, rig.snapshot.last_event_severity) == ("robot_found", INFO)
    rig.step(2.0)
    assert len(rig.navigation.driving) == 1 and rig.state == state


@pytest.mark.parametrize("state", [*DRIVING, "INSPECTING.SCANNING", "MONITORING.SCANNING"])
def test_robot_that_is_not_found_ends_its_mission(make_rig: type[Rig], state: str) -> None:
    rig = make_rig(localization_timeout_s=5.0)
    rig.bring_to(state)
    lose(rig)
    rig.step(4.9)
    assert rig.state == state
    rig.step(0.5)
    assert (rig.state, rig.snapshot.last_error) == ("FAULT", "robot_not_found")
    assert rig.snapshot.last_event_severity == ERROR and not rig.navigation.driving
    assert "lupin mission reset" in " ".join(rig.publisher.lines)
    rig.step(10.0)
    assert not rig.navigation.driving


def test_time_of_a_pause_or_stop_does_not_count(make_rig: type[Rig]) -> None:
    rig = make_rig(localization_timeout_s=5.0)
    rig.inspect("1")
    lose(rig)
    rig.step()
    rig.orchestrator.on_estop(True)
    rig.step(20.0)
    rig.orchestrator.on_estop(False)
    rig.step(20.0)  # the e-stop has paused the mission
    assert rig.state == "INSPECTING.NAVIGATING"
    assert rig.requests.resume().success
    rig.step()
    assert rig.snapshot.last_error == "robot_lost"
    rig.step(3.9)
    assert rig.state == "INSPECTING.NAVIGATING" and not rig.navigation.driving
    rig.step(1.5)
    assert rig.state == "FAULT"


def test_resume_of_a_lost_robot_waits_until_it_is_found(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.inspect("1")
    assert rig.requests.pause().success
    lose(rig)
    rig.step()
    assert rig.requests.resume().success
    rig.step(1.0)
    assert not rig.navigation.driving
    rig.localize()
    rig.step(1.0)
    rig.arrive()
    assert rig.statuses() == [("1", OK, "")]


def test_robot_that_is_lost_outside_a_mission_stops_no_start(make_rig: type[Rig]) -> None:
    rig = make_rig(localization_timeout_s=5.0)
    lose(rig)
    rig.step(20.0)
    assert rig.state == "READY"
    rig.inspect("1")
    assert rig.state == "PREPARE.LOCALIZING" and not rig.navigation.driving
    rig.localize()
    rig.step()
    assert rig.navigation.driving
