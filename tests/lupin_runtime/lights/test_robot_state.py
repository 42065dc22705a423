"""What the robot is doing by itself, and the mission whose laptop vanished."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from lupin_runtime import home_report
from lupin_runtime.home_report import HomeReport, read_report, write_report
from lupin_runtime.lights.mission_watch import MissionWatch
from lupin_runtime.lights.precedence import Mission, View, choose
from lupin_runtime.lights.robot_state import Facts, RobotState, judge

HOME = HomeReport(home_report.HOME)
S = 10**9


@pytest.mark.parametrize(
    ("facts", "state"),
    [
        (Facts(1.0, None), RobotState.WAITING),
        (Facts(119.0, None), RobotState.WAITING),
        (Facts(121.0, None), RobotState.HELP),
        (Facts(60.0, 2.9, HOME), RobotState.READY),
        (Facts(60.0, 3.1, HOME), RobotState.WAITING),
        (Facts(60.0, 10.1, HOME), RobotState.HELP),
        (Facts(9.0, 0.1), RobotState.WAITING),  # auto-home starts after this
        (Facts(11.0, 0.1), RobotState.READY),
        (Facts(1.0, 0.1, HOME), RobotState.READY),
        (Facts(1.0, 0.1, HomeReport(home_report.HOME, at_s=-1.0)), RobotState.WAITING),  # of an earlier start
        (Facts(1.0, 0.1, HomeReport(home_report.FAILED, "x", at_s=-1.0)), RobotState.WAITING),
        (Facts(11.0, 0.1, HomeReport(home_report.HOME, at_s=-1.0)), RobotState.READY),
        (Facts(11.0, 0.1, HomeReport(home_report.FAILED, "x", at_s=-1.0)), RobotState.HELP),
        (Facts(50.0, 0.1, HomeReport(home_report.RETRYING, "no controller")), RobotState.WAITING),
        (Facts(5.0, 0.1, HomeReport(home_report.OFF)), RobotState.READY),
        (Facts(5.0, 0.1, HomeReport(home_report.ACTIVATING)), RobotState.WAITING),
        (Facts(5.0, 0.1, HomeReport(home_report.HOMING)), RobotState.HOMING),
        (Facts(5.0, 0.1, HOME, moves_home=True), RobotState.HOMING),
        (Facts(5.0, 0.1, HomeReport(home_report.FAILED, "no controller")), RobotState.HELP),
        (Facts(5.0, 0.1, HomeReport(home_report.ESTOPPED, "e-stop")), RobotState.HELP),
        (Facts(5.0, None, HomeReport(home_report.HOMING), mission_lost=True), RobotState.HELP),
    ],
)
def test_robot_state_follows_from_the_facts(facts: Facts, state: RobotState) -> None:
    found, reason = judge(facts)
    assert found is state
    assert bool(reason) == (state is not RobotState.READY)


def test_reason_for_help_is_that_of_auto_home() -> None:
    assert "no controller" in judge(Facts(5.0, 0.1, HomeReport(home_report.FAILED, "no controller"))).reason


def test_lost_mission_hides_no_other_reason() -> None:
    lost = "the laptop fell silent during its mission: the robot stands"
    failed = HomeReport(home_report.FAILED, "no controller")
    assert judge(Facts(60.0, 0.1, failed, mission_lost=True)).reason == f"{lost}; the arm is not home: no controller"
    assert judge(Facts(60.0, 0.1, HOME, mission_lost=True)) == (RobotState.HELP, lost)


def test_mission_is_lost_if_its_publisher_stays_and_is_silent() -> None:
    watch = MissionWatch(2.0)
    watch.handle(Mission("EXPLORING"), 0)
    assert watch.view(1 * S, 1) == Mission("EXPLORING") and not watch.lost
    assert watch.view(3 * S, 1) == Mission("EXPLORING", fresh=False) and watch.lost
    watch.view(60 * S, 0)  # the lease of the laptop has expired meanwhile
    assert watch.lost
    watch.handle(Mission("EXPLORING"), 61 * S)
    assert not watch.lost


@pytest.mark.parametrize("mission", [Mission("FAULT"), Mission("EXPLORING", estop=True)])
def test_robot_forgets_a_stop_of_a_silent_laptop(mission: Mission) -> None:
    watch, other = MissionWatch(2.0, forgets=True), MissionWatch(2.0)
    for each in (watch, other):
        each.handle(mission, 0)
        assert choose(View(each.view(1 * S, 1)))[0] == "e-stop or fault"
    silent = watch.view(3 * S, 1)
    assert choose(View(silent))[0] == "ready" and choose(View(silent, driving=True))[0] == "driving"
    assert choose(View(silent, estop=True))[0] == "e-stop or fault", "the robot's own"
    assert choose(View(other.view(3 * S, 1)))[0] == "e-stop or fault"


@pytest.mark.parametrize(("lifecycle", "publishers"), [("EXPLORING", 0), ("READY", 1), ("DONE", 1), ("BOOT", 1)])
def test_mission_that_ended_or_rested_is_not_lost(lifecycle: str, publishers: int) -> None:
    watch = MissionWatch(2.0)
    watch.handle(Mission(lifecycle), 0)
    watch.view(1 * S, 1)
    watch.view(3 * S, publishers)
    assert not watch.lost


def test_report_of_auto_home_is_read_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))
    assert read_report(tmp_path) is None
    write_report(home_report.HOMING)
    assert read_report(tmp_path) == HomeReport(home_report.HOMING, "", os.getpid())
    write_report(home_report.FAILED, "no controller")
    assert read_report(tmp_path) == HomeReport(home_report.FAILED, "no controller", os.getpid())


def test_report_of_a_process_that_was_killed_is_a_failure(tmp_path: Path) -> None:
    gone = 2**22 + 1  # above the kernel's largest process number
    (tmp_path / home_report.NAME).write_text(json.dumps({"state": "homing", "reason": "", "pid": gone}))
    found = read_report(tmp_path)
    assert found is not None and found.state == home_report.FAILED


@pytest.mark.parametrize("text", ["", "[]", '{"state": 1, "reason": "", "pid": 1}', '{"state": "home"}'])
def test_damaged_report_counts_as_none(tmp_path: Path, text: str) -> None:
    (tmp_path / home_report.NAME).write_text(text)
    assert read_report(tmp_path) is None


@pytest.mark.parametrize(("ago_s", "state"), [(1.0, home_report.RETRYING), (100.0, home_report.FAILED)])
def test_retry_that_does_not_come_is_a_failure(tmp_path: Path, ago_s: float, state: str) -> None:
    at_s = home_report.since_boot_s() - ago_s
    report = {"state": home_report.RETRYING, "reason": "no controller", "pid": 1, "at_s": at_s}
    (tmp_path / home_report.NAME).write_text(json.dumps(report))
    found = read_report(tmp_path)
    assert found is not None and (found.state, found.reason) == (state, "no controller") and found.at_s == at_s
