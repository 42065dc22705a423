"""`lupin up --target robot` on the laptop, the onboard services on a simulated robot, and a cable between them."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lupin_sim.host.operator import environment_without_ros
from tests.support.true_path import Sample, moved_m, parse_path
from tests.support.waiting import wait_until

if TYPE_CHECKING:
    from lupin_sim.host import Host

pytestmark = [pytest.mark.host, pytest.mark.mission]

TRUTH = "/home/mirte/truth"

# Sends a goal on the map and prints its result.
CLIENT = """
import sys, time
import rclpy
from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import NavigateToPose
from lupin_runtime import graph
from lupin_runtime.ros import LupinNode

rclpy.init()
node = LupinNode("somebody")
client = node.action_client(graph.NAVIGATE_TO_POSE)
if not client.wait_for_server(timeout_sec=30.0):
    sys.exit("no navigation")
goal = NavigateToPose.Goal()
goal.pose.header.frame_id = graph.MAP_FRAME
goal.pose.pose.position.x, goal.pose.pose.orientation.w = float(sys.argv[1]), 1.0
for _ in range(4):  # a server that has not discovered this client yet can't respond
    sent = client.send_goal_async(goal)
    rclpy.spin_until_future_complete(node, sent, timeout_sec=5.0)
    if sent.done():
        break
print("accepted" if sent.done() and sent.result().accepted else "refused", flush=True)
ended = sent.result().get_result_async()
rclpy.spin_until_future_complete(node, ended, timeout_sec=90.0)
print(ended.result().status if ended.done() else "no end", flush=True)
"""


class Laptop:
    """An operator's laptop, connected to a simulated robot."""

    def __init__(self, host: Host, home: Path) -> None:
        self.host = host
        self.home = home
        self.environment = {
            **environment_without_ros(),
            "HOME": str(home),
            "SHELL": "/bin/bash",
            "XDG_STATE_HOME": str(home / "state"),
        }
        self.environment.pop("XDG_CONFIG_HOME", None)

    def lupin(self, *words: str) -> subprocess.CompletedProcess[str]:
        return self.host.run([sys.executable, "-m", "lupin_cli.app", *words], env=self.environment, timeout_s=60.0)

    def starts(self, *command: str, **environment: str) -> subprocess.Popen[str]:
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        return self.host.popen([sys.executable, *command], {**self.environment, **environment}, **pipes)

    def exports(self) -> dict[str, str]:
        """Return the variables that ros-env.sh sets in a terminal."""
        output = subprocess.run(
            ["bash", "-c", f". {self.home}/.config/lupin/ros-env.sh; env"],
            env=self.environment, capture_output=True, text=True, check=True,
        ).stdout  # fmt: skip
        pairs = (line.split("=", 1) for line in output.splitlines() if "=" in line)
        return {name: value for name, value in pairs if name not in self.environment}


def truth(host: Host) -> list[Sample]:
    return parse_path(host.robot.run_as_root("cat", f"{TRUTH}/truth_trajectory.tum").stdout)


@pytest.fixture
def laptop(lupin_host: Host, tmp_path: Path) -> Laptop:
    run_as_root = lupin_host.robot.run_as_root
    arguments = f"--wall-clock --no-cameras --world walled --run-dir {TRUTH}"
    script = f"""install -d -o mirte {TRUTH}; sed -i "s|^ROBOT_ARGUMENTS=.*|ROBOT_ARGUMENTS='{arguments}'|" /etc/mirte/robot
systemctl restart mirte-ros
systemctl stop lupin-onboard"""  # which starts with the vendor's software
    done = run_as_root("sh", "-ec", script, timeout_s=60.0)
    assert done.status == 0, done.stderr
    return Laptop(lupin_host, tmp_path)


def test_cut_cable_stops_a_robot_driven_by_the_laptop(laptop: Laptop) -> None:
    host = laptop.host
    refused = laptop.lupin("up", "--target", "robot")
    assert refused.returncode == 2
    assert "lupin dds setup" in refused.stderr
    assert laptop.lupin("dds", "setup", host.robot.eth0).returncode == 0
    up = laptop.starts("-m", "lupin_cli.app", "up", "--target", "robot", "--headless", "--no-yolo", "--no-record", "--json")
    try:
        state = laptop.home / "state" / "lupin" / "runs"

        def state_of(key: str) -> Any:
            assert up.poll() is None, up.communicate()
            texts = [path.read_text() for path in state.glob("*/state.json")]
            return json.loads(texts[0])[key] if texts else []

        def waits() -> str:
            robot = next((stage for stage in state_of("stages") if stage["name"] == "robot"), None)
            return "; ".join(robot["waiting_for"]) if robot else ""

        # Only the vendor's software runs: the onboard processes are waited for.
        wait_until(lambda: "/e_stop_state: no publisher" in waits() and "/scan" not in waits(), "what it waits for", 90.0)
        assert host.robot.run_as_root("systemctl", "start", "lupin-onboard", timeout_s=60.0).status == 0
        wait_until(lambda: all(stage["phase"] == "up" for stage in state_of("stages")), "every stage up", 90.0)
        client = laptop.starts("-c", CLIENT, "2.2", **laptop.exports())
        try:
            assert client.stdout is not None
            assert client.stdout.readline() == "accepted\n"
            wait_until(lambda: moved_m(truth(host)) > 0.3, "a robot that drives", 60.0)
            for link in ("eth0", "wlan0"):
                host.robot.inject_fault("cable-cut", link=link)
            cut = len(truth(host))
            # Without the laptop's commands the drive bus sends zero: the robot stops and stays.
            at_rest = wait_until(
                lambda: len(found := truth(host)) > cut + 10 and moved_m(found[-10:]) < 0.002 and found, "rest", 10.0
            )
            wait_until(lambda: len(truth(host)) > len(at_rest) + 20, "two seconds more", 60.0)  # type: ignore[arg-type]
            track = truth(host)
            assert moved_m(track[len(at_rest) :]) < 0.005  # type: ignore[arg-type]
            assert moved_m(track[cut:]) < 0.6  # including the lag of the record
            assert math.dist(track[0][1:], track[-1][1:]) < 1.8  # it was still driving
            wait_until(lambda: sorted(state_of("silent_s")) == ["/e_stop_state", "/scan"], "the silent topics", 60.0)
            for link in ("eth0", "wlan0"):
                host.robot.undo_fault("cable-cut", link=link)
            wait_until(lambda: state_of("silent_s") == {}, "both machines on one graph again", 90.0)
        finally:
            client.kill()
            client.communicate()
    finally:
        for link in ("eth0", "wlan0"):
            host.robot.undo_fault("cable-cut", link=link)
        up.terminate()
        try:
            output = up.communicate(timeout=60.0)
        except subprocess.TimeoutExpired:
            up.kill()
            output = up.communicate()
    assert up.returncode == 130, output
