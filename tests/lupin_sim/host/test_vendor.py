"""The stand-ins for the vendor's units hold the same ports, and robot and laptop share one ROS graph over a cable."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from urllib.request import urlopen

import pytest

from lupin_sim.host import Host
from lupin_sim.host.host import PROJECT
from tests.support.waiting import wait_until

pytestmark = pytest.mark.host

CLIENT = {"ROS_DISCOVERY_SERVER": "10.42.0.1:11811", "ROS_SUPER_CLIENT": "TRUE", "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}
# Drives until the odometry shows motion, and prints what it received meanwhile.
DRIVER = """
import json, time
import rclpy
from lupin_runtime import graph
from lupin_runtime.ros import LupinNode
from geometry_msgs.msg import Twist

rclpy.init()
node = LupinNode("driver")
received = {"scans": 0, "start_m": None, "drove_m": 0.0, "latency_s": None}

def scan(message):
    received["scans"] += 1
    received["latency_s"] = time.time() - message.header.stamp.sec - message.header.stamp.nanosec / 1e9

def odom(message):
    x_m = message.pose.pose.position.x
    if received["start_m"] is None:
        received["start_m"] = x_m
    received["drove_m"] = x_m - received["start_m"]

node.subscription(graph.SCAN, scan)
node.subscription(graph.ODOM, odom)
wheels = node.publisher(graph.CMD_VEL_SINK_ROBOT)
forward = Twist()
forward.linear.x = 0.2
deadline = time.monotonic() + 45.0
while (received["drove_m"] < 0.1 or received["scans"] < 5) and time.monotonic() < deadline:
    rclpy.spin_once(node, timeout_sec=0.05)
    wheels.publish(forward)
print(json.dumps(received))
"""


def test_units_are_active_and_hold_the_vendors_ports(host: Host) -> None:
    units = "mirte-ros mirte-ap mirte-wifi-watchdog mirte-web-interface mirte-jupyter ssh chrony"
    wait_until(lambda: host.ssh(f"systemctl is-active {units}").stdout.split() == ["active"] * 7, "the units")
    wait_until(lambda: ":11811" in host.ssh("sudo ss -lnu").stdout, "the discovery server")
    listening = host.ssh("sudo ss -lntu").stdout
    for endpoint in ("%wlan0:67", "*:80", "[::1]:8181", "0.0.0.0:9090", "0.0.0.0:8888"):
        assert endpoint in listening
    with host.on_laptop(), urlopen("http://10.42.0.1/", timeout=60) as page:
        assert page.read() == b"MIRTE\n"


def test_killed_server_is_not_restarted_by_the_service(fresh_host: Host) -> None:
    fresh_host.ssh("sudo pkill -x fast-discovery-")
    assert fresh_host.ssh("systemctl is-active mirte-ros").stdout == "active\n"
    assert ":11811" not in fresh_host.ssh("sudo ss -lnu").stdout


def test_access_point_stays_down_only_without_its_watchdog(fresh_host: Host) -> None:
    fresh_host.ssh("sudo systemctl stop mirte-ap")
    wait_until(lambda: "192.168.42.1" in fresh_host.ssh("ip -4 -br address show wlan0").stdout, "the access point")
    fresh_host.ssh("sudo systemctl disable --now mirte-ap mirte-wifi-watchdog")
    assert "192.168.42.1" not in fresh_host.ssh("ip -4 -br address").stdout


def test_vendors_hook_overwrites_the_dds_settings(host: Host) -> None:
    hook = (
        "source mirte_ws/install/setup.bash; echo $ROS_DISCOVERY_SERVER; grep -c SUPER_CLIENT $FASTRTPS_DEFAULT_PROFILES_FILE"
    )
    assert host.ssh(f"export MIRTE_FASTDDS=true; {hook}").stdout.split() == ["127.0.0.1", "1"]
    environment = host.ssh(
        "export ROS_DISCOVERY_SERVER=10.42.0.1:11811; source mirte_ws/install/setup.bash; env | grep ROS_"
    ).stdout
    assert "DISCOVERY" not in environment


def test_laptop_and_robot_share_one_graph_over_the_cable(boot_host: Callable[..., Host], tmp_path: Path) -> None:
    host = boot_host(vendor_robot=True)
    env = {"PATH": "/usr/bin:/bin", "HOME": str(tmp_path), **CLIENT}
    done = host.run([sys.executable, "-c", DRIVER], env=env, cwd=str(PROJECT), timeout_s=90.0)
    received = json.loads(done.stdout)
    assert received["drove_m"] >= 0.1, (received, host.ssh("journalctl -u mirte-ros -o cat").stdout)
    assert received["scans"] >= 5
    assert abs(received["latency_s"]) < 5.0  # stamped with the robot's clock, not with simulated time
    short_driver = DRIVER.replace("45.0", "6.0")
    # The signature of dual-homing: scans still arrive, and the robot receives no command.
    with host.robot.with_fault("dual-homed"):
        one_way = json.loads(host.run([sys.executable, "-c", short_driver], env=env, cwd=str(PROJECT)).stdout)
    assert one_way["scans"] > 0
    assert one_way["drove_m"] < 0.02
    # With stuck controllers the robot does not move.
    with host.robot.with_fault("controllers-stuck"):
        stuck = json.loads(host.run([sys.executable, "-c", short_driver], env=env, cwd=str(PROJECT)).stdout)
        assert stuck["drove_m"] == 0.0
        assert "--controllers unconfigured" in host.ssh("pgrep -af lupin_sim").stdout
    wait_until(lambda: "--controllers active" in host.ssh("pgrep -af lupin_sim").stdout, "the simulated robot")
    # With both cables cut, the laptop receives nothing: there is no other route between the two.
    host.robot.inject_fault("cable-cut", link="eth0")
    host.robot.inject_fault("cable-cut", link="wlan0")
    assert json.loads(host.run([sys.executable, "-c", short_driver], env=env, cwd=str(PROJECT)).stdout)["scans"] == 0
