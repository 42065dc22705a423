"""`lupin home` and `lupin sweep` from the laptop, against a simulated computer."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import pytest

from tests.support.waiting import wait_until

if TYPE_CHECKING:
    from .conftest import Operator

pytestmark = pytest.mark.host

PARTICIPANT = """
import os, signal, sys
if os.fork():
    os.waitpid(-1, os.WUNTRACED)  # until it is killed or stopped; then the parent exits
    os._exit(0)
os.setsid()
null = os.open("/dev/null", os.O_RDWR)
os.dup2(null, 1), os.dup2(null, 2)
import rclpy
rclpy.init()
node = rclpy.create_node("left_over")
os.kill(os.getpid(), signal.{signal})
"""
SETTLED_S = 6.0
KILLED, STOPPED = PARTICIPANT.format(signal="SIGKILL"), PARTICIPANT.format(signal="SIGSTOP")


def test_home_activates_controllers_and_reports_each_change(operator: Operator) -> None:
    operator.host.robot.inject_fault("controllers-stuck", state="unloaded")
    try:
        assert operator.host.robot.run_as_root("systemctl", "start", "lupin-onboard", timeout_s=60.0).status == 0
        done = operator.run("home", "--robot", "mirte", "--patience", "1")
    finally:
        operator.host.robot.undo_fault("controllers-stuck")
        operator.host.robot.run_as_root("systemctl", "start", "lupin-onboard", timeout_s=60.0)
    assert done.returncode == 0, done.stdout + done.stderr
    for line in ("mirte_base_controller is not loaded", "load mirte_base_controller", "configure mirte_base_controller"):
        assert line in done.stdout, done.stdout
    assert "now: all 5 controllers are active" in done.stdout and "arm: moving to home" in done.stdout


def test_home_without_deployed_release_names_next_command(operator: Operator) -> None:
    operator.host.robot.run_as_root("mv", "/opt/lupin", "/opt/lupin-away")
    try:
        done = operator.run("home", "--robot", "mirte")
    finally:
        operator.host.robot.run_as_root("mv", "/opt/lupin-away", "/opt/lupin")
    assert done.returncode == 1 and "next: lupin deploy robot --robot mirte" in done.stderr


def segments(operator: Operator) -> set[str]:
    """Return the segments of participants. Port files are ignored: they come and go during discovery."""
    names = operator.host.robot.run_as_root("ls", "/dev/shm").stdout.split()
    return {name for name in names if name.startswith("fastrtps_") and "port" not in name}


def settled_segments(operator: Operator) -> set[str]:
    """Start the onboard unit, and return the segments once none has come or gone for SETTLED_S: units may still be starting."""
    assert operator.host.robot.run_as_root("systemctl", "start", "lupin-onboard", timeout_s=60.0).status == 0
    seen: list[tuple[float, set[str]]] = [(time.monotonic(), segments(operator))]

    def are_settled() -> bool:
        now = segments(operator)
        if now != seen[-1][1]:
            seen.append((time.monotonic(), now))
        return time.monotonic() - seen[-1][0] > SETTLED_S and operator.state("lupin-onboard") == "active"

    wait_until(are_settled, "the robot's participants to settle", timeout_s=90.0)
    return seen[-1][1]


def test_sweep_removes_memory_of_killed_process_only(operator: Operator) -> None:
    live = settled_segments(operator)
    operator.run_on_robot(KILLED)
    orphans = segments(operator) - live
    assert len(orphans) == 2  # the segment and its lock

    def plans_to_remove_them() -> bool:
        status, plan = operator.run_json("sweep", "--robot", "mirte", "--dry-run")
        return status == 1 and {name for segment in plan["orphans"] for name in segment["files"]} >= orphans

    # A live participant that has read from the segment holds it until it notices the death of its owner.
    wait_until(plans_to_remove_them, "a plan to remove the memory of the killed process", timeout_s=30.0)
    status, result = operator.run_json("sweep", "--robot", "mirte")
    assert status == 0 and result["failed"] == [] and result["ended"] == []
    assert not orphans & segments(operator)
    assert [operator.state(unit) for unit in ("mirte-ros", "lupin-onboard")] == ["active", "active"]
    assert any("part of mirte-ros.service" in kept["why"] for kept in result["kept"])


def test_sweep_terminates_stopped_process_only(operator: Operator) -> None:
    operator.run_on_robot(STOPPED)
    status, result = operator.run_json("sweep", "--robot", "mirte")
    assert status == 0 and [each["why"] for each in result["ended"]] == ["it is stopped and does not respond"], result
    assert [operator.state(unit) for unit in ("mirte-ros", "lupin-onboard")] == ["active", "active"]
    assert operator.run("sweep", "--robot", "mirte").stdout.splitlines()[-1] == "nothing is left over"
