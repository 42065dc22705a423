"""The units on a robot computer that really boots: systemd starts, watches, limits and stops them."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable

import pytest

from lupin_sim.host import Host

pytestmark = pytest.mark.host
BOUND_S = 60.0


def show(host: Host, unit: str, *properties: str) -> list[str]:
    said = host.robot.inside("systemctl", "show", "--value", *(f"--property={name}" for name in properties), unit)
    return said.stdout.split("\n\n") if len(properties) > 1 else [said.stdout.strip()]


def state(host: Host, unit: str) -> str:
    return show(host, unit, "ActiveState")[0]


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


CONTROLLERS = """
import sys, rclpy
from rclpy.node import Node
from controller_manager_msgs.srv import ListControllers, SwitchController
rclpy.init()
node = Node("stuck")
switch = node.create_client(SwitchController, "/controller_manager/switch_controller")
assert switch.wait_for_service(20.0)
request = SwitchController.Request(deactivate_controllers=sys.argv[1:], strictness=SwitchController.Request.BEST_EFFORT)
future = switch.call_async(request)
rclpy.spin_until_future_complete(node, future, timeout_sec=20.0)
assert future.result().ok
"""


def test_a_boot_brings_the_onboard_stack_up_heals_stuck_controllers_and_sends_the_arm_home(robot_host: Host, as_mirte) -> None:
    robot = robot_host.robot
    as_mirte(CONTROLLERS, "mirte_base_controller", "mirte_master_arm_controller")
    done = robot.inside("systemctl", "start", "lupin-auto-home", timeout_s=BOUND_S)
    assert done.status == 0, journal(robot_host, "lupin-auto-home")
    said = journal(robot_host, "lupin-auto-home")
    assert "found: mirte_master_arm_controller is inactive, mirte_base_controller is inactive" in said
    assert "now: all 5 controllers are active" in said and "arm: home sent" in said
    # It came up because auto-home wants it, and it was ready before auto-home began.
    assert state(robot_host, "lupin-onboard") == "active"
    assert show(robot_host, "lupin-onboard", "StatusText") == ["up: estop, drive, body"]
    assert set(stages(robot_host)) == {"estop", "drive", "body"}


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
    robot.inside("kill", "-9", show(robot_host, "lupin-onboard", "MainPID")[0])
    until(
        lambda: show(robot_host, "lupin-onboard", "NRestarts") == ["1"] and state(robot_host, "lupin-onboard") == "active",
        lambda: journal(robot_host, "lupin-onboard"),
    )


def test_it_stops_with_the_vendors_service_and_says_its_zero_before(robot_host: Host) -> None:
    robot = robot_host.robot
    assert robot.inside("systemctl", "start", "lupin-auto-home", timeout_s=BOUND_S).status == 0
    assert robot.inside("systemctl", "stop", "mirte-ros", timeout_s=BOUND_S).status == 0
    assert [state(robot_host, unit) for unit in ("lupin-onboard", "lupin-auto-home")] == ["inactive", "inactive"]
    said = journal(robot_host, "lupin-onboard")
    assert "[twist_mux]: locked: shutting down" in said and "killed" not in said
    assert robot.inside("pgrep", "-f", "lupin_runtime").status == 1


def test_without_a_discovery_server_it_is_not_ready_and_says_what_it_waits_for(robot_host: Host) -> None:
    robot = robot_host.robot
    assert robot.inside("pkill", "-9", "-x", "fast-discovery-").status == 0
    robot.inside("systemctl", "start", "--no-block", "lupin-onboard")
    until(
        lambda: "waiting for: estop" in show(robot_host, "lupin-onboard", "StatusText")[0],
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
