"""`lupin home` and `lupin sweep` from the laptop, on a robot computer that really boots."""

from __future__ import annotations

import pytest

pytestmark = pytest.mark.host

PARTICIPANT = """
import os, signal, sys
if os.fork():
    os.waitpid(-1, os.WUNTRACED)  # until it is killed or stopped: then who started it is gone
    os._exit(0)
os.setsid()
null = os.open("/dev/null", os.O_RDWR)
os.dup2(null, 1), os.dup2(null, 2)
import rclpy
rclpy.init()
node = rclpy.create_node("left_over")
os.kill(os.getpid(), signal.{signal})
"""
KILLED, STOPPED = PARTICIPANT.format(signal="SIGKILL"), PARTICIPANT.format(signal="SIGSTOP")


def test_home_loads_configures_and_activates_over_ssh_and_says_what_it_found_and_did(operator) -> None:
    operator.host.robot.fault("controllers-stuck", state="unloaded")
    try:
        assert operator.host.robot.inside("systemctl", "start", "lupin-onboard", timeout_s=60.0).status == 0
        done = operator.types("home", "--robot", "mirte", "--patience", "1")
    finally:
        operator.host.robot.mend("controllers-stuck")
        operator.host.robot.inside("systemctl", "start", "lupin-onboard", timeout_s=60.0)
    assert done.returncode == 0, done.stdout + done.stderr
    for line in ("mirte_base_controller is not loaded", "load mirte_base_controller", "configure mirte_base_controller"):
        assert line in done.stdout, done.stdout
    assert "now: all 5 controllers are active" in done.stdout and "arm: home sent" in done.stdout


def test_home_says_what_is_missing_where_nothing_was_deployed(operator) -> None:
    operator.host.robot.inside("mv", "/opt/lupin", "/opt/lupin-away")
    try:
        done = operator.types("home", "--robot", "mirte")
    finally:
        operator.host.robot.inside("mv", "/opt/lupin-away", "/opt/lupin")
    assert done.returncode == 1 and "next: lupin deploy robot" in done.stderr


def segments(operator) -> set[str]:
    """Of participants; the ports between them come and go while the stack finds each other."""
    names = operator.host.robot.inside("ls", "/dev/shm").stdout.split()
    return {name for name in names if name.startswith("fastrtps_") and "port" not in name}


def test_sweep_removes_a_killed_participants_memory_and_spares_the_live_stack(operator) -> None:
    live = segments(operator)
    operator.runs_there(KILLED)
    left = segments(operator) - live
    assert len(left) == 2  # it and its lock
    status, plan = operator.asks("sweep", "--robot", "mirte", "--dry-run")
    assert status == 1 and {name for orphan in plan["orphans"] for name in orphan["files"]} >= left
    status, result = operator.asks("sweep", "--robot", "mirte")
    assert status == 0 and result["failed"] == [] and result["ended"] == []
    assert not left & segments(operator)
    assert [operator.state(unit) for unit in ("mirte-ros", "lupin-onboard")] == ["active", "active"]
    assert any("part of mirte-ros.service" in kept["why"] for kept in result["kept"])


def test_sweep_ends_a_hung_participant_and_nothing_else(operator) -> None:
    operator.runs_there(STOPPED)
    status, result = operator.asks("sweep", "--robot", "mirte")
    assert status == 0 and [each["why"] for each in result["ended"]] == ["it is stopped and answers nobody"], result
    assert [operator.state(unit) for unit in ("mirte-ros", "lupin-onboard")] == ["active", "active"]
    assert operator.types("sweep", "--robot", "mirte").stdout.splitlines()[-1] == "nothing is left over"
