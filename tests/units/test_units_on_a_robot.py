"""The units on a robot computer that really boots: systemd starts, watches, limits and stops them."""

from __future__ import annotations

import json
import re
import shlex
import sys
import time
from collections.abc import Callable

import pytest

from lupin_sim.host import Host
from lupin_sim.host.host import PROJECT

pytestmark = pytest.mark.host
BOUND_S = 60.0
# Says for each topic how often it was heard in five seconds after it was first heard at all.
LISTENER = """
import time
import rclpy
from lupin_runtime import graph
from lupin_runtime.ros import LupinNode
rclpy.init(args=[])
node, heard = LupinNode("listener"), {}
for row in (graph.ESTOP_STATE, graph.DRIVE_STATUS):
    node.subscription(row, lambda _, name=row.name: heard.setdefault(name, []).append(time.monotonic()))
def until(condition, bound_s):
    end = time.monotonic() + bound_s
    while not condition() and time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)
until(lambda: len(heard) == 2, 20.0)
until(lambda: False, 5.0)
print(*(len(heard.get(row.name, [])) for row in (graph.ESTOP_STATE, graph.DRIVE_STATUS)))
"""


def show(host: Host, unit: str, name: str) -> str:
    return host.robot.inside("systemctl", "show", "--value", f"--property={name}", unit).stdout.strip()


def state(host: Host, unit: str) -> str:
    return show(host, unit, "ActiveState")


def journal(host: Host, unit: str) -> str:
    host.robot.inside("journalctl", "--sync")
    return host.robot.inside("journalctl", "--no-pager", "--output=cat", "--unit", unit).stdout


def until(condition: Callable[[], object], what: Callable[[], str]) -> None:
    deadline = time.monotonic() + BOUND_S
    while not condition():
        assert time.monotonic() < deadline, what()
        time.sleep(0.1)


def stages(host: Host) -> dict[str, dict]:
    said = host.robot.inside("sh", "-c", "cat /run/lupin-onboard/lupin/runs/*/state.json")
    return {stage["name"]: stage for stage in json.loads(said.stdout)["stages"]} if said.stdout else {}


def test_a_boot_brings_the_onboard_stack_up_heals_stuck_controllers_and_sends_the_arm_home(robot_host: Host) -> None:
    robot = robot_host.robot
    robot.fault("controllers-stuck", state="unconfigured")
    done = robot.inside("systemctl", "start", "lupin-auto-home", timeout_s=BOUND_S)
    assert done.status == 0, journal(robot_host, "lupin-auto-home")
    said = journal(robot_host, "lupin-auto-home")
    assert "mirte_master_arm_controller is unconfigured" in said and "activate " in said
    assert "now: all 5 controllers are active" in said and "arm: home sent" in said
    # It came up because auto-home wants it, and it was ready before auto-home began.
    assert state(robot_host, "lupin-onboard") == "active"
    assert show(robot_host, "lupin-onboard", "StatusText") == "up: estop, drive, body"
    assert set(stages(robot_host)) == {"estop", "drive", "body"}
    robot.mend("controllers-stuck")


def test_a_killed_process_comes_back_alone_and_a_killed_supervisor_brings_all_back(robot_host: Host) -> None:
    robot = robot_host.robot
    assert robot.inside("systemctl", "start", "lupin-onboard", timeout_s=BOUND_S).status == 0
    before = stages(robot_host)
    robot.inside("kill", "-9", str(before["drive"]["pid"]))
    until(
        lambda: stages(robot_host)["drive"]["restarts"] == 1 and stages(robot_host)["drive"]["phase"] == "up",
        lambda: journal(robot_host, "lupin-onboard"),
    )
    assert stages(robot_host)["estop"]["pid"] == before["estop"]["pid"]
    robot.inside("kill", "-9", show(robot_host, "lupin-onboard", "MainPID"))
    until(
        lambda: show(robot_host, "lupin-onboard", "NRestarts") == "1" and state(robot_host, "lupin-onboard") == "active",
        lambda: journal(robot_host, "lupin-onboard"),
    )


def test_a_clock_that_is_stepped_back_by_five_minutes_silences_neither_stop_nor_bus(robot_host: Host) -> None:
    robot = robot_host.robot
    robot.fault("clock-wrong", offset_s=300.0)
    try:
        assert robot.inside("systemctl", "start", "lupin-onboard", timeout_s=BOUND_S).status == 0
    finally:
        robot.mend("clock-wrong")
    profile = "/home/mirte/mirte_ws/install/super_client.xml"
    where = f"ROS_DISCOVERY_SERVER=127.0.0.1 FASTRTPS_DEFAULT_PROFILES_FILE={profile} PYTHONPATH={PROJECT}"
    done = robot.inside("sh", "-c", f"{where} {sys.executable} -c {shlex.quote(LISTENER)}", timeout_s=BOUND_S)
    stops, words = map(int, done.stdout.split())
    assert stops >= 10 and words >= 3, done.stderr  # 5 Hz and 1 Hz, on a busy machine


def test_it_stops_with_the_vendors_service_in_good_order(robot_host: Host) -> None:
    robot = robot_host.robot
    assert robot.inside("systemctl", "start", "lupin-auto-home", timeout_s=BOUND_S).status == 0
    assert robot.inside("systemctl", "stop", "mirte-ros", timeout_s=BOUND_S).status == 0
    assert [state(robot_host, unit) for unit in ("lupin-onboard", "lupin-auto-home")] == ["inactive", "inactive"]
    said = journal(robot_host, "lupin-onboard")
    assert "lupin-onboard.service: Deactivated successfully." in said and "Killing" not in said
    assert show(robot_host, "lupin-onboard", "Result") == "success"
    assert robot.inside("pgrep", "-f", "lupin_runtime").status == 1


def test_without_a_discovery_server_it_is_not_ready_and_says_what_it_waits_for(robot_host: Host) -> None:
    robot = robot_host.robot
    assert robot.inside("pkill", "-9", "-x", "fast-discovery-").status == 0
    robot.inside("systemctl", "start", "--no-block", "lupin-onboard")
    until(
        lambda: "waiting for: estop" in show(robot_host, "lupin-onboard", "StatusText"),
        lambda: journal(robot_host, "lupin-onboard"),
    )
    assert state(robot_host, "lupin-onboard") == "activating"
    robot.inside("systemctl", "stop", "lupin-onboard", timeout_s=BOUND_S)
    assert state(robot_host, "lupin-onboard") == "inactive"


def test_systemd_there_has_nothing_to_say_against_the_units(robot_host: Host) -> None:
    said = robot_host.robot.inside(
        "systemd-analyze", "verify", *(f"/etc/systemd/system/lupin-{name}.service" for name in ("onboard", "auto-home"))
    )
    assert (said.status, said.stderr) == (0, "")
    limits = robot_host.robot.inside("systemctl", "show", "lupin-onboard").stdout
    for line in ("LimitRTPRIO=1", "MemoryMax=268435456", "ProtectClock=yes", "KillMode=mixed", "OOMPolicy=continue"):
        assert re.search(rf"^{line}$", limits, re.MULTILINE), line
