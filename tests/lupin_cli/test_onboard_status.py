"""The status of a robot by itself, judged from what its probes print."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from lupin_cli.connection.base import Output
from lupin_cli.facts.onboard import UNITS, Onboard, Pad, parse
from lupin_cli.facts.units import VENDOR, Unit, Units
from lupin_cli.onboard_status import judge
from lupin_cli.systemd.units import AUTO_HOME, CAMERAS, ONBOARD
from lupin_runtime.cameras.driver_state import ABSENT, DriverState

CAPTURED = Path(__file__).parent / "facts" / "captured" / "onboard" / "auto-home-failed.txt"
READY = {"state": "ready", "reason": "", "light": "ready", "arm": True, "since_s": 60.0}


def unit(name: str, active: str = "active", sub: str = "running", load: str = "loaded", result: str = "success") -> Unit:
    return Unit(name, load, active, sub, result, "notify", 0, "enabled", (), 1, 0, 100.0, 90.0, False, f"/etc/{name}")


def machine(**changed: Unit) -> Units:
    units = {name: unit(name) for name in UNITS} | {each.name: each for each in changed.values()}
    return Units(systemd=True, units=tuple(units.values()), uptime_s=160.0)


@pytest.fixture
def healthy() -> Onboard:
    """A robot that is ready, with the processes of a captured run."""
    return replace(parse(Output(0, CAPTURED.read_text())), robot=READY, last_lines={}, uptime_s=160.0)


def test_robot_that_is_ready_has_no_problem(healthy: Onboard) -> None:
    found = judge("mirte", machine(), healthy, {})
    assert found.ready and found.doing == "ready" and found.problems == ()
    assert [line.since_s for line in found.units] == [60.0] * 4
    assert found.devices["gamepad"] == "Microsoft Xbox Series S|X Controller"


def test_failed_auto_home_is_named_with_its_last_line() -> None:
    captured = parse(Output(0, CAPTURED.read_text()))
    found = judge("mirte", machine(home=unit(AUTO_HOME, "failed", "failed", result="exit-code")), captured, {})
    assert found.doing == "needs help" and not found.ready
    by_text = {problem.text: problem.next_command for problem in found.problems}
    assert any(text.startswith(f"{AUTO_HOME} failed (exit-code): controllers not active") for text in by_text)
    assert set(by_text.values()) == {"lupin home"}


@pytest.mark.parametrize(
    ("changed", "text", "command"),
    [
        (unit(ONBOARD, load="not-found"), f"{ONBOARD} is not installed", "lupin deploy robot"),
        (unit(VENDOR, load="not-found"), f"{VENDOR} is not installed", "lupin doctor"),
        (unit(CAMERAS, "inactive", "dead"), f"{CAMERAS} is inactive (dead)", f"sudo systemctl start {CAMERAS}"),
        (unit(ONBOARD, "activating", "start"), f"{ONBOARD} is activating (start)", f"journalctl -b -u {ONBOARD} -n 50"),
        (unit(ONBOARD, "failed", "failed", result="oom-kill"), f"{ONBOARD} failed (oom-kill)", "lupin doctor"),
    ],
)
def test_unit_that_does_not_run_has_a_next_command(healthy: Onboard, changed: Unit, text: str, command: str) -> None:
    (problem,) = judge("mirte", machine(changed=changed), healthy, {}).problems
    assert (problem.text, problem.next_command) == (text, command)


def test_state_is_unknown_without_the_process_that_judges_it(healthy: Onboard) -> None:
    processes = tuple(
        replace(each, phase="starting", why="no service") if each.name == "body" else each for each in healthy.processes
    )
    found = judge("mirte", machine(), replace(healthy, processes=processes), {})
    assert found.doing == "unknown" and not found.ready
    assert [problem.text for problem in found.problems] == ["body is starting: no service"]


@pytest.mark.parametrize("processes", [True, False])
def test_unknown_state_has_a_next_command(healthy: Onboard, processes: bool) -> None:
    """The units run, and nothing was written: of a version that writes nothing, or on a full disk."""
    state = replace(healthy, robot=None, processes=healthy.processes if processes else ())
    (problem,) = judge("mirte", machine(), state, {}).problems
    assert problem.next_command == f"journalctl -b -u {ONBOARD} -n 50"


@pytest.mark.parametrize(
    ("state", "light", "problems"),
    [("waiting for vendor", "waiting for vendor", 0), ("homing", "homing", 0), ("ready", "e-stop or fault", 1)],
)
def test_robot_that_is_not_ready_yet_is_not_wrong(healthy: Onboard, state: str, light: str, problems: int) -> None:
    found = judge("mirte", machine(), replace(healthy, robot={**READY, "state": state, "light": light}), {})
    assert not found.ready and len(found.problems) == problems


def test_unreadable_pad_and_absent_camera_are_problems(healthy: Onboard) -> None:
    state = replace(healthy, pads=(Pad("event5", "Xbox", readable=False),))
    found = judge("mirte", machine(), state, {"body": DriverState(ABSENT, "no camera is connected")})
    assert found.devices["gamepad"] == "Xbox (may not be read)"
    assert [problem.next_command for problem in found.problems] == ["lupin deploy robot", "lupin doctor"]


def test_robot_without_systemd_says_so(healthy: Onboard) -> None:
    (problem,) = judge("mirte", Units(systemd=False, pid1="sh"), healthy, {}).problems
    assert "sh" in problem.text
