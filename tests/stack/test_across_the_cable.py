"""`lupin up --target robot` on the laptop, the robot's own half under its units, and one cable between the two computers."""

from __future__ import annotations

import itertools
import json
import math
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lupin_sim.host.operator import off_graph

if TYPE_CHECKING:
    from lupin_sim.host import Host

pytestmark = [pytest.mark.host, pytest.mark.mission]

TRUTH = "/home/mirte/truth"
# As a deploy sets it: else the robot's own publishers, the simulator's among them, stall for an absent laptop's address.
WAITING_BYTES = 65536

# Asks for a place of the map and tells what becomes of it.
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
for _ in range(4):  # a server that has not met this client's ears yet can't answer
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
    """An operator's laptop on a host's cables."""

    def __init__(self, host: Host, home: Path) -> None:
        self.host = host
        self.home = home
        self.environment = {**off_graph(), "HOME": str(home), "SHELL": "/bin/bash", "XDG_STATE_HOME": str(home / "state")}
        self.environment.pop("XDG_CONFIG_HOME", None)

    def lupin(self, *words: str) -> subprocess.CompletedProcess[str]:
        return self.host.run([sys.executable, "-m", "lupin_cli.app", *words], env=self.environment, timeout_s=60.0)

    def starts(self, *command: str, **environment: str) -> subprocess.Popen[str]:
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        return self.host.popen([sys.executable, *command], {**self.environment, **environment}, **pipes)

    def exports(self) -> dict[str, str]:
        """What ros-env.sh gives a terminal."""
        said = subprocess.run(
            ["bash", "-c", f". {self.home}/.config/lupin/ros-env.sh; env"],
            env=self.environment, capture_output=True, text=True, check=True,
        ).stdout  # fmt: skip
        pairs = (line.split("=", 1) for line in said.splitlines() if "=" in line)
        return {name: value for name, value in pairs if name not in self.environment}


def until(condition: Callable[[], Any], what: str, limit_s: float = 60.0) -> Any:
    deadline = time.monotonic() + limit_s
    while not (value := condition()):
        assert time.monotonic() < deadline, f"{what} did not come about within {limit_s:g} s"
        time.sleep(0.1)
    return value


def truth(host: Host) -> list[tuple[float, float, float]]:
    """Where the robot truly was: seconds, x, y, ten times a second."""
    text = host.robot.inside("cat", f"{TRUTH}/truth_trajectory.tum").stdout
    rows = [line.split() for line in text.splitlines() if not line.startswith("#")]
    return [(float(row[0]), float(row[1]), float(row[2])) for row in rows if len(row) == 8]


def moved_m(track: list[tuple[float, float, float]]) -> float:
    return sum(math.hypot(b[1] - a[1], b[2] - a[2]) for a, b in itertools.pairwise(track))


@pytest.fixture
def laptop(lupin_robot: Host, tmp_path: Path) -> Iterator[Laptop]:
    inside = lupin_robot.robot.inside
    arguments = f"--wall-clock --no-cameras --world walled --run-dir {TRUTH}"
    script = f"""install -d -o mirte {TRUTH}; sed -i "s|^ROBOT_ARGUMENTS=.*|ROBOT_ARGUMENTS='{arguments}'|" /etc/mirte/robot
for each in /proc/sys/net/ipv4/neigh/*/unres_qlen_bytes; do echo {WAITING_BYTES} > $each; done
systemctl restart mirte-ros"""
    done = inside("sh", "-ec", script, timeout_s=60.0)
    assert done.status == 0, done.stderr
    yield Laptop(lupin_robot, tmp_path)


def test_the_robot_is_driven_across_the_cable_and_a_pulled_cable_stops_its_wheels(laptop: Laptop) -> None:
    host = laptop.host
    refused = laptop.lupin("up", "--target", "robot")
    assert refused.returncode == 2
    assert "lupin dds setup" in refused.stderr
    assert laptop.lupin("dds", "setup", host.robot.eth0).returncode == 0
    up = laptop.starts("-m", "lupin_cli.app", "up", "--target", "robot", "--headless", "--no-yolo", "--no-record", "--json")
    try:
        state = laptop.home / "state" / "lupin" / "runs"

        def told(key: str) -> Any:
            assert up.poll() is None, up.communicate()
            texts = [path.read_text() for path in state.glob("*/state.json")]
            return json.loads(texts[0])[key] if texts else []

        def waits() -> str:
            robot = next((stage for stage in told("stages") if stage["name"] == "robot"), None)
            return "; ".join(robot["waiting_for"]) if robot else ""

        # The vendor's half is there, and nothing of ours: that is what it says.
        until(lambda: "/e_stop_state: nobody publishes it" in waits() and "/scan" not in waits(), "what it waits for", 90.0)
        assert host.robot.inside("systemctl", "start", "lupin-onboard", timeout_s=60.0).status == 0
        until(lambda: all(stage["phase"] == "up" for stage in told("stages")), "a robot and a half that are up", 90.0)
        client = laptop.starts("-c", CLIENT, "2.2", **laptop.exports())
        try:
            assert client.stdout is not None
            assert client.stdout.readline() == "accepted\n"
            until(lambda: moved_m(truth(host)) > 0.3, "a robot that drives")
            for link in ("eth0", "wlan0"):
                host.robot.fault("cable-cut", link=link)
            cut = len(truth(host))
            # Its own half misses the laptop's commands and says zero: it comes to rest, and stays there.
            at_rest = until(
                lambda: len(found := truth(host)) > cut + 10 and moved_m(found[-10:]) < 0.002 and found, "rest", 10.0
            )
            until(lambda: len(truth(host)) > len(at_rest) + 20, "two seconds more")
            track = truth(host)
            assert moved_m(track[len(at_rest) :]) < 0.005
            assert moved_m(track[cut:]) < 0.6  # what the record lags included
            assert math.dist(track[0][1:], track[-1][1:]) < 1.8  # it was still on its way
            until(lambda: sorted(told("silent_s")) == ["/e_stop_state", "/scan"], "word of the silence")
            for link in ("eth0", "wlan0"):
                host.robot.mend("cable-cut", link=link)
            until(lambda: told("silent_s") == {}, "the two on one graph again", 90.0)
        finally:
            client.kill()
            client.communicate()
    finally:
        for link in ("eth0", "wlan0"):
            host.robot.mend("cable-cut", link=link)
        up.terminate()
        try:
            said = up.communicate(timeout=60.0)
        except subprocess.TimeoutExpired:
            up.kill()
            said = up.communicate()
    assert up.returncode == 130, said
