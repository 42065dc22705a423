"""A mission across a WiFi link: the robot is a booted computer on its access point, and the laptop has its own network.

The robot's computer runs the vendor's stack with the simulated robot and its cameras, and `lupin-onboard.service`. The laptop
runs `lupin up --target robot --mission`. The cable between the two is cut before anything starts, so that DDS announces the
access point's addresses only.
"""

from __future__ import annotations

import contextlib
import json
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bench.booted import LUPIN, Operator, booted_operator
from bench.runner import note
from tests.support.onboard_units import install_units
from tests.support.true_path import Sample, moved_m, parse_path

TRUTH = "/home/mirte/truth"
TRUTH_FILES = ("truth.json", "truth_trajectory.tum", "sim_state.json")
LINK, OTHER_LINK = "wlan0", "eth0"
WIFI: Mapping[str, Mapping[str, float]] = {
    "slow-link": {"delay_ms": 20.0, "jitter_ms": 0.0},
    "lossy-link": {"loss": 0.02},
    "narrow-link": {"rate_mbit_s": 10.0},
}
UNITS = ("lupin-onboard.service",)
SET_UP_TIMEOUT_S, UP_TIMEOUT_S, END_TIMEOUT_S = 90.0, 180.0, 60.0
POLL_S = 0.2
STOP_S = 1.0  # the drive bus stops the wheels when no command has come for 0.5 s; they brake
DRIVING_M_S = 0.1

# Prints how many subscriptions each camera topic has, once those of the JPEGs are known.
CAMERA_SUBSCRIBERS = """
import json, sys, time
import rclpy
from lupin_runtime import graph
rclpy.init()
node = rclpy.create_node("camera_subscribers")
images = (graph.BODY_IMAGE_ROBOT, graph.GRIPPER_IMAGE)
names = [row.name for image in images for row in (image, graph.compressed(image))]
until = time.monotonic() + 20.0
while time.monotonic() < until and not node.count_subscribers(graph.compressed(graph.BODY_IMAGE_ROBOT).name):
    rclpy.spin_once(node, timeout_sec=0.2)
rclpy.spin_once(node, timeout_sec=1.0)
print(json.dumps({name: node.count_subscribers(name) for name in names}))
"""


@dataclass(frozen=True)
class LinkFault:
    """A fault of the link during the mission, and its time on the wall clock."""

    name: str
    from_s: float
    to_s: float


@dataclass
class LinkRig:
    """A robot and a laptop that is set up for it, with a link between them."""

    operator: Operator
    faults: list[LinkFault] = field(default_factory=list)

    @property
    def _robot(self) -> Any:
        return self.operator.host.robot

    def run_as_root(self, script: str, timeout_s: float = SET_UP_TIMEOUT_S, stdin: str = "") -> str:
        """Run a script on the robot, and return its output. Ends the benchmark if it fails."""
        done = self._robot.run_as_root("sh", "-ec", script, timeout_s=timeout_s, stdin=stdin)
        if done.status != 0:
            raise SystemExit(f"not measured: status {done.status} on the robot: {done.stderr.strip()[-300:]}")
        return str(done.stdout)

    def set_up(self) -> None:
        """Install Lupin's unit on the robot, start its stack on the access point only, and set the laptop up for it."""
        self._robot.inject_fault("cable-cut", link=OTHER_LINK)
        install_units(self._robot, UNITS)
        self.run_as_root(f"systemctl restart mirte-ros; systemctl start {' '.join(UNITS)}")
        self.operator.require(self.operator.lupin("dds", "setup", self._robot.wlan0))

    def shape(self, faults: Mapping[str, Mapping[str, float]]) -> None:
        """Shape the link by faults of the simulated computer."""
        for name, settings in faults.items():
            self._robot.inject_fault(name, link=LINK, **settings)

    @contextlib.contextmanager
    def without_link(self, fault: str) -> Iterator[None]:
        """Interrupt the link during the block."""
        from_s = time.time()
        with self._robot.with_fault(fault, link=LINK):
            yield
        self.faults.append(LinkFault(fault, from_s, time.time()))

    def truth(self) -> list[Sample]:
        """Return the robot's true path so far, ten places a second."""
        return parse_path(self.run_as_root(f"cat {TRUTH}/truth_trajectory.tum"))

    def is_driving(self) -> bool:
        """Whether the robot drove during the last second."""
        last = self.truth()[-11:]
        return len(last) == 11 and moved_m(last) > DRIVING_M_S * (last[-1].t_s - last[0].t_s)

    def sent_bytes(self) -> int:
        """Return how many bytes crossed the link in both directions since the robot booted."""
        folder = f"/sys/class/net/{LINK}/statistics"
        return sum(map(int, self.run_as_root(f"cat {folder}/tx_bytes {folder}/rx_bytes").split()))


@contextlib.contextmanager
def link_rig(world: str) -> Iterator[LinkRig]:
    """Boot both machines with a robot in this world, and set them up. Exits if this machine cannot boot them."""
    arguments = f"--wall-clock --world {world} --run-dir {TRUTH}"
    with booted_operator(vendor_robot=True, graphics=True, robot_arguments=arguments) as operator:
        rig = LinkRig(operator)
        rig.set_up()
        yield rig


@dataclass
class Mission:
    """`lupin up --target robot --mission` on the laptop."""

    rig: LinkRig
    process: subprocess.Popen[str]

    @property
    def folder(self) -> Path | None:
        """The run's directory; None before it exists."""
        return next(iter((self.rig.operator.home / "state" / "lupin" / "runs").glob("*/")), None)

    def state(self) -> dict[str, Any]:
        """Return the run's state; empty before it is written."""
        folder = self.folder
        with contextlib.suppress(OSError, ValueError):
            found: dict[str, Any] = json.loads((folder / "state.json").read_text()) if folder else {}
            return found
        return {}

    def wait_for(self, what: str, holds: Callable[[], bool], timeout_s: float) -> bool:
        """Wait until something holds; return False if the run ends before, and end the benchmark after the timeout."""
        deadline = time.monotonic() + timeout_s
        while self.process.poll() is None:
            if holds():
                return True
            if time.monotonic() > deadline:
                raise SystemExit(f"not measured: no {what} within {timeout_s:.0f} s: {json.dumps(self.state())[:2000]}")
            time.sleep(POLL_S)
        return False

    def camera_subscribers(self) -> dict[str, int]:
        """Return the number of subscriptions to each camera topic, on the graph of both machines."""
        home = self.rig.operator.home
        shell = f'. {home}/.config/lupin/ros-env.sh; exec {LUPIN[0]} -c "$0"'
        done = self.rig.operator.require(self.rig.operator.run(["bash", "-c", shell, CAMERA_SUBSCRIBERS]))
        found: dict[str, int] = json.loads(done.stdout)
        return found

    def result(self, timeout_s: float) -> dict[str, Any]:
        """Wait until the run has ended; return what `lupin up --json` printed."""
        try:
            output, errors = self.process.communicate(timeout=timeout_s)
        except subprocess.TimeoutExpired:
            raise SystemExit(f"not measured: the run did not end within {timeout_s:.0f} s: {self.state()}") from None
        if not output.strip():
            raise SystemExit(f"not measured: status {self.process.returncode}: {errors[-1000:]}")
        found: dict[str, Any] = json.loads(output)
        return found


@contextlib.contextmanager
def running_mission(rig: LinkRig, *options: str) -> Iterator[Mission]:
    """Start a mission that reads every tag once, and stop the run after the block."""
    options = ("--mission", "--headless", "--no-yolo", "--discovery-goal", "all", "--sweeps", "1", *options)
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    command = [*LUPIN, "up", "--target", "robot", "--json", *options]
    from lupin_sim.host.host import PROJECT

    process = rig.operator.host.popen(command, rig.operator.environment, cwd=str(PROJECT), **pipes)
    try:
        yield Mission(rig, process)
    finally:
        if process.poll() is None:
            process.terminate()
        try:
            process.communicate(timeout=END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            note("the run did not stop")
            process.kill()
            process.communicate()


def score(rig: LinkRig, folder: Path) -> dict[str, Any]:
    """Compare the run with the robot's truth; return the score with the simulator's collisions and real-time factor."""
    from lupin_cli.run.summary import score_run

    for name in TRUTH_FILES:
        (folder / name).write_text(rig.run_as_root(f"cat {TRUTH}/{name}"))
    state = json.loads((folder / "sim_state.json").read_text())
    return {**score_run(folder), "collisions": state["collisions"], "real_time_factor": state["real_time_factor"]}


def in_outage(track: Sequence[Sample], fault: LinkFault) -> dict[str, float]:
    """Return how far the robot drove while the link was interrupted, in all and after it had the time to stop."""
    inside = [sample for sample in track if fault.from_s <= sample.t_s <= fault.to_s]
    at_rest = [sample for sample in inside if sample.t_s >= fault.from_s + STOP_S]
    return {"lasted_s": fault.to_s - fault.from_s, "moved_m": moved_m(inside), "moved_after_stop_m": moved_m(at_rest)}
