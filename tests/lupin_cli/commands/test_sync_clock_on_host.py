"""`lupin sync-clock` against a simulated computer with a wrong clock and a running stack."""

from __future__ import annotations

import subprocess
import sys
import time
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from .conftest import Operator

pytestmark = pytest.mark.host

UNITS = ("mirte-ros", "lupin-onboard", "lupin-auto-home")


@pytest.fixture
def running(operator: Operator) -> Operator:
    """Return the operator of a robot with a running stack and a correct clock."""
    started = operator.host.robot.run_as_root("systemctl", "start", *UNITS, timeout_s=120.0)
    assert started.status == 0, journal(operator)
    operator.host.robot.undo_fault("clock-wrong")
    return operator


def journal(operator: Operator) -> str:
    units = [f"--unit={unit}" for unit in UNITS]
    return operator.host.robot.run_as_root("journalctl", "--no-pager", "--output=cat", "--lines=60", *units).stdout


def true_offset_s(operator: Operator) -> float:
    return float(operator.host.robot.state["clock_offset_s"])


def test_offset_within_tolerance_changes_nothing(running: Operator) -> None:
    running.host.robot.inject_fault("clock-wrong", offset_s=2.5)
    pids = running.host.robot.run_as_root("pgrep", "-f", "lupin_").stdout
    steps_before = running.clock_steps
    status, report = running.run_json("sync-clock", "--robot", "mirte")
    assert status == 0 and report["done"] == "nothing"
    assert abs(report["before"]["offset_s"] - true_offset_s(running)) <= report["before"]["bound_s"] + 1e-3
    assert running.clock_steps == steps_before and running.host.robot.run_as_root("pgrep", "-f", "lupin_").stdout == pids


def test_large_offset_is_stepped_while_stack_is_stopped(running: Operator) -> None:
    robot = running.host.robot
    robot.inject_fault("clock-wrong", offset_s=-16_440.0)
    steps_before = running.clock_steps
    status, report = running.run_json("sync-clock", "--robot", "mirte", "--dry-run")
    assert (
        report["done"] == "would play sync-clock" and running.clock_steps == steps_before and true_offset_s(running) < -16_000
    )
    status, report = running.run_json("sync-clock", "--robot", "mirte")
    assert status == 0, f"{report}\n{journal(running)}"
    assert report["before"]["offset_s"] == pytest.approx(-16_440.0, abs=1.0)
    assert abs(report["after"]["offset_s"]) < 1.0 > abs(true_offset_s(running)) and running.clock_steps == steps_before + 1
    assert [running.state(unit) for unit in UNITS] == ["active"] * 3
    named = [step["name"].lower() for step in report["steps"] if step["state"] == "changed"]
    order = [
        next(i for i, name in enumerate(named) if word in name)
        for word in ("stop the vendor's stack", "set the clock", "start the vendor's stack")
    ]
    assert order == sorted(order)
    # A second run changes nothing.
    assert running.run_json("sync-clock", "--robot", "mirte")[1]["done"] == "nothing"


def test_resume_after_kill_restarts_stopped_stack(running: Operator) -> None:
    running.host.robot.inject_fault("clock-wrong", offset_s=-16_440.0)
    steps_before = running.clock_steps
    words = [sys.executable, "-m", "lupin_cli.app", "sync-clock", "--robot", "mirte"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with running.host.popen(words, env=running.environment, **quiet) as lupin:
        while running.state("mirte-ros") != "inactive":
            assert lupin.poll() is None, "sync-clock exited before the stack was down"
            time.sleep(0.05)
        lupin.kill()
    status, report = running.run_json("sync-clock", "--robot", "mirte", "--resume")
    assert status == 0, f"{report}\n{journal(running)}"
    assert abs(true_offset_s(running)) < 1.0 and running.clock_steps == steps_before + 1
    assert [running.state(unit) for unit in UNITS] == ["active"] * 3


def test_boot_script_never_steps_clock_of_running_stack(running: Operator) -> None:
    from lupin_cli.systemd.units import clock_sync_script

    robot = running.host.robot
    robot.inject_fault("clock-wrong", offset_s=-600.0)
    steps_before = running.clock_steps
    robot.run_as_root("sh", "-c", "cat > /tmp/clock-sync; chmod 755 /tmp/clock-sync", stdin=clock_sync_script())
    done = robot.run_as_root("/tmp/clock-sync", "10.42.0.2")
    assert done.status == 0 and "mirte-ros is active; the clock is left as it is" in done.stdout
    assert running.clock_steps == steps_before


def test_installed_boot_sync_steps_clock_before_stack_starts(running: Operator) -> None:
    robot = running.host.robot
    done = running.run("play", "install-clock-sync", "--robot", "mirte", "-v", "laptop_serves=false", "--yes")
    assert done.returncode == 0, done.stdout + done.stderr
    assert robot.run_as_root("grep", "-c", "^makestep", "/etc/chrony/chrony.conf").stdout.strip() == "0"
    running.host.serve_ntp()
    robot.power_cut()
    robot.inject_fault("clock-wrong", offset_s=-16_440.0)
    robot.power_on()
    robot.wait_ready()
    robot.run_as_root("systemctl", "start", "mirte-ros", timeout_s=120.0)  # blocks until the units before it have started
    log = robot.run_as_root("journalctl", "--no-pager", "--output=cat", "--unit=lupin-clock-sync").stdout
    assert "stepped to 10.42.0.2's time" in log, log
    assert abs(true_offset_s(running)) < 0.5
    show = "systemctl show --property=ActiveEnterTimestampMonotonic --value {}"
    synced, started = (
        int(robot.run_as_root("sh", "-c", show.format(unit)).stdout) for unit in ("lupin-clock-sync", "mirte-ros")
    )
    assert 0 < synced < started
