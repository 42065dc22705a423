"""The vendor's side: its units hold what the real ones hold, and its robot is on one graph with the laptop across a cable."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from urllib.request import urlopen

import pytest

from lupin_sim.host import Host
from lupin_sim.host.fixtures import until
from lupin_sim.host.host import PROJECT

pytestmark = pytest.mark.host

CLIENT = {"ROS_DISCOVERY_SERVER": "10.42.0.1:11811", "ROS_SUPER_CLIENT": "TRUE", "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}
# Drives until the wheels' own odometry says that the robot moved, and says what it got meanwhile.
DRIVER = """
import json, time
import rclpy
from lupin_runtime import graph
from lupin_runtime.ros import LupinNode
from geometry_msgs.msg import Twist

rclpy.init()
node = LupinNode("driver")
got = {"scans": 0, "from_m": None, "drove_m": 0.0, "late_s": None}

def scan(message):
    got["scans"] += 1
    got["late_s"] = time.time() - message.header.stamp.sec - message.header.stamp.nanosec / 1e9

def odom(message):
    x_m = message.pose.pose.position.x
    if got["from_m"] is None:
        got["from_m"] = x_m
    got["drove_m"] = x_m - got["from_m"]

node.subscription(graph.SCAN, scan)
node.subscription(graph.ODOM, odom)
wheels = node.publisher(graph.CMD_VEL_SINK_ROBOT)
forward = Twist()
forward.linear.x = 0.2
deadline = time.monotonic() + 45.0
while (got["drove_m"] < 0.1 or got["scans"] < 5) and time.monotonic() < deadline:
    rclpy.spin_once(node, timeout_sec=0.05)
    wheels.publish(forward)
print(json.dumps(got))
"""


def test_the_units_are_active_and_hold_the_ports_of_the_real_ones(host: Host) -> None:
    units = "mirte-ros mirte-ap mirte-wifi-watchdog mirte-web-interface mirte-jupyter ssh chrony"
    until(lambda: host.ssh(f"systemctl is-active {units}").stdout.split() == ["active"] * 7, "the units")
    until(lambda: ":11811" in host.ssh("sudo ss -lnu").stdout, "the discovery server")
    listening = host.ssh("sudo ss -lntu").stdout
    for place in ("%wlan0:67", "*:80", "[::1]:8181", "0.0.0.0:9090", "0.0.0.0:8888"):
        assert place in listening
    with host.on_laptop(), urlopen("http://10.42.0.1/", timeout=5) as page:
        assert page.read() == b"MIRTE\n"


def test_the_server_is_started_once_and_the_service_goes_on_without_it(fresh_host: Host) -> None:
    fresh_host.ssh("sudo pkill -x fast-discovery-")
    assert fresh_host.ssh("systemctl is-active mirte-ros").stdout == "active\n"
    assert ":11811" not in fresh_host.ssh("sudo ss -lnu").stdout


def test_the_access_point_comes_back_unless_its_watchdog_is_stopped_too(fresh_host: Host) -> None:
    fresh_host.ssh("sudo systemctl stop mirte-ap")
    until(lambda: "192.168.42.1" in fresh_host.ssh("ip -4 -br address show wlan0").stdout, "the access point")
    fresh_host.ssh("sudo systemctl disable --now mirte-ap mirte-wifi-watchdog")
    assert "192.168.42.1" not in fresh_host.ssh("ip -4 -br address").stdout


def test_the_vendors_hook_owns_the_dds_settings(host: Host) -> None:
    hook = (
        "source mirte_ws/install/setup.bash; echo $ROS_DISCOVERY_SERVER; grep -c SUPER_CLIENT $FASTRTPS_DEFAULT_PROFILES_FILE"
    )
    assert host.ssh(f"export MIRTE_FASTDDS=true; {hook}").stdout.split() == ["127.0.0.1", "1"]
    wiped = host.ssh("export ROS_DISCOVERY_SERVER=10.42.0.1:11811; source mirte_ws/install/setup.bash; env | grep ROS_").stdout
    assert "DISCOVERY" not in wiped


def test_laptop_and_robot_are_two_computers_on_one_graph(boot_host: Callable[..., Host], tmp_path: Path) -> None:
    host = boot_host(vendor_robot=True)
    env = {"PATH": "/usr/bin:/bin", "HOME": str(tmp_path), **CLIENT}
    done = host.run([sys.executable, "-c", DRIVER], env=env, cwd=str(PROJECT), timeout_s=90.0)
    got = json.loads(done.stdout)
    assert got["drove_m"] >= 0.1, (got, host.ssh("journalctl -u mirte-ros -o cat").stdout)
    assert got["scans"] >= 5
    assert abs(got["late_s"]) < 5.0  # stamped by the robot's clock, not in simulated time
    still = DRIVER.replace("45.0", "6.0")
    # Dual-homed, scans still come, and the robot hears no command: the fingerprint of that fault.
    with host.robot.broken("dual-homed"):
        one_way = json.loads(host.run([sys.executable, "-c", still], env=env, cwd=str(PROJECT)).stdout)
    assert one_way["scans"] > 0
    assert one_way["drove_m"] < 0.02
    # The controllers boot as a fault wants them, and the robot doesn't move.
    with host.robot.broken("controllers-stuck"):
        stuck = json.loads(host.run([sys.executable, "-c", still], env=env, cwd=str(PROJECT)).stdout)
        assert stuck["drove_m"] == 0.0
        assert "--controllers unconfigured" in host.ssh("pgrep -af lupin_sim").stdout
    until(lambda: "--controllers active" in host.ssh("pgrep -af lupin_sim").stdout, "the simulated robot")
    # Pulled, the laptop hears nothing: the cable is the only way between the two.
    host.robot.fault("cable-cut", link="eth0")
    host.robot.fault("cable-cut", link="wlan0")
    assert json.loads(host.run([sys.executable, "-c", still], env=env, cwd=str(PROJECT)).stdout)["scans"] == 0
