"""`lupin sync-clock` against a robot whose clock is really off, with its stack really running."""

from __future__ import annotations

import subprocess
import sys
import time

import pytest

pytestmark = pytest.mark.host

UNITS = ("mirte-ros", "lupin-onboard", "lupin-auto-home")


@pytest.fixture
def running(operator):
    """The whole stack is up, its clock right."""
    started = operator.host.robot.inside("systemctl", "start", *UNITS, timeout_s=120.0)
    assert started.status == 0, journal(operator)
    operator.host.robot.mend("clock-wrong")
    return operator


def journal(operator) -> str:
    units = [f"--unit={unit}" for unit in UNITS]
    return operator.host.robot.inside("journalctl", "--no-pager", "--output=cat", "--lines=60", *units).stdout


def truth_s(operator) -> float:
    return float(operator.host.robot.state["clock_offset_s"])


def test_within_three_seconds_nothing_is_touched(running) -> None:
    running.host.robot.fault("clock-wrong", offset_s=2.5)
    pids = running.host.robot.inside("pgrep", "-f", "lupin_").stdout
    steps = running.steps
    status, said = running.asks("sync-clock", "--robot", "mirte")
    assert status == 0 and said["done"] == "nothing"
    assert abs(said["before"]["offset_s"] - truth_s(running)) <= said["before"]["bound_s"] + 1e-3
    assert running.steps == steps and running.host.robot.inside("pgrep", "-f", "lupin_").stdout == pids


def test_hours_behind_the_stack_is_stopped_the_clock_stepped_and_everything_started_again(running) -> None:
    robot = running.host.robot
    robot.fault("clock-wrong", offset_s=-16_440.0)
    steps = running.steps
    status, said = running.asks("sync-clock", "--robot", "mirte", "--dry-run")
    assert said["done"] == "would play sync-clock" and running.steps == steps and truth_s(running) < -16_000
    status, said = running.asks("sync-clock", "--robot", "mirte")
    assert status == 0, f"{said}\n{journal(running)}"
    assert said["before"]["offset_s"] == pytest.approx(-16_440.0, abs=1.0)
    assert abs(said["after"]["offset_s"]) < 1.0 > abs(truth_s(running)) and running.steps == steps + 1
    assert [running.state(unit) for unit in UNITS] == ["active"] * 3
    named = [step["name"].lower() for step in said["steps"] if step["state"] == "changed"]
    order = [
        next(i for i, name in enumerate(named) if word in name) for word in ("stack is stopped", "clock is set", "stack is up")
    ]
    assert order == sorted(order)
    # Again: everything is as it should be.
    assert running.asks("sync-clock", "--robot", "mirte")[1]["done"] == "nothing"


def test_killed_while_the_stack_is_down_it_goes_on_where_it_was_and_the_stack_is_up_again(running) -> None:
    running.host.robot.fault("clock-wrong", offset_s=-16_440.0)
    steps = running.steps
    words = [sys.executable, "-m", "lupin_cli.app", "sync-clock", "--robot", "mirte"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with running.host.popen(words, env=running.environment, **quiet) as lupin:
        while running.state("mirte-ros") != "inactive":
            assert lupin.poll() is None, "it ended before the stack was down"
            time.sleep(0.05)
        lupin.kill()
    status, said = running.asks("sync-clock", "--robot", "mirte", "--resume")
    assert status == 0, f"{said}\n{journal(running)}"
    assert abs(truth_s(running)) < 1.0 and running.steps == steps + 1
    assert [running.state(unit) for unit in UNITS] == ["active"] * 3


def test_the_boot_time_script_leaves_the_clock_of_a_live_stack_alone(running) -> None:
    from lupin_cli.units import clock_sync_script

    robot = running.host.robot
    robot.fault("clock-wrong", offset_s=-600.0)
    steps = running.steps
    robot.inside("sh", "-c", "cat > /tmp/clock-sync; chmod 755 /tmp/clock-sync", stdin=clock_sync_script())
    began = time.monotonic()
    said = robot.inside("/tmp/clock-sync", "10.42.0.2")
    assert said.status == 0 and "mirte-ros is active; the clock is left as it is" in said.stdout
    assert running.steps == steps and time.monotonic() - began < 20.0


def test_after_install_a_boot_takes_the_laptops_time_in_one_step_before_the_stack_starts(running) -> None:
    robot = running.host.robot
    done = running.types("play", "install-clock-sync", "--robot", "mirte", "-v", "laptop_serves=false", "--yes")
    assert done.returncode == 0, done.stdout + done.stderr
    assert robot.inside("grep", "-c", "^makestep", "/etc/chrony/chrony.conf").stdout.strip() == "0"
    running.host.serve_ntp()
    robot.power_cut()
    robot.fault("clock-wrong", offset_s=-16_440.0)
    robot.power_on()
    robot.wait_ready()
    robot.inside("systemctl", "start", "mirte-ros", timeout_s=120.0)  # returns when its turn has come
    said = robot.inside("journalctl", "--no-pager", "--output=cat", "--unit=lupin-clock-sync").stdout
    assert "stepped to 10.42.0.2's time" in said, said
    assert abs(truth_s(running)) < 0.5
    show = "systemctl show --property=ActiveEnterTimestampMonotonic --value {}"
    synced, started = (int(robot.inside("sh", "-c", show.format(unit)).stdout) for unit in ("lupin-clock-sync", "mirte-ros"))
    assert 0 < synced < started
