"""Options of the simulated robot's command line, and invalid arguments."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install ./interfaces")

from controller_manager_msgs.srv import ConfigureController, ListControllers, SwitchController

from lupin_runtime import graph

if TYPE_CHECKING:
    from tests.lupin_sim.conftest import GraphClient, RobotProcess

pytestmark = [pytest.mark.graph, pytest.mark.sim]


@pytest.fixture
def start(start_robot: type[RobotProcess], join_graph: type[GraphClient]) -> Iterator[Callable[..., Any]]:
    """A function that starts a robot and joins its graph. Afterwards the robot must exit with status 0."""
    started = []

    def start_and_join(*arguments: Any, **environment: Any) -> tuple[RobotProcess, GraphClient]:
        started.append((start_robot(*arguments, **environment), join_graph()))
        started[-1][1].next_message(graph.SCAN)
        return started[-1]

    yield start_and_join
    for robot, client in started:
        client.close()
        if robot.process.poll() is None:
            assert robot.stop()[0] == 0


def test_unconfigured_controllers_publish_only_after_activation(start: Callable[..., Any]) -> None:
    _, client = start("--world", "walled", "--no-cameras", "--controllers", "unconfigured")
    client.subscribe(graph.JOINT_STATES, graph.ODOM)
    client.next_message(graph.SCAN)
    client.next_message(graph.SCAN)
    assert client.count[graph.JOINT_STATES.name] == client.count[graph.ODOM.name] == 0
    listed = client.call(graph.LIST_CONTROLLERS, ListControllers.Request()).controller
    assert {c.state for c in listed} == {"unconfigured"}
    for name in graph.CONTROLLERS:
        assert client.call(graph.CONFIGURE_CONTROLLER, ConfigureController.Request(name=name)).ok
    request = SwitchController.Request(activate_controllers=list(graph.CONTROLLERS), strictness=1)
    assert client.call(graph.SWITCH_CONTROLLER, request).ok
    client.next_message(graph.JOINT_STATES)
    client.next_message(graph.ODOM)


def test_robot_without_graphics_runs_and_names_the_packages(start: Callable[..., Any]) -> None:
    robot, client = start("--world", "walled", MUJOCO_GL="disable")
    client.next_message(graph.SCAN)
    client.next_message(graph.ODOM)
    status, stderr = robot.stop()
    assert status == 0
    assert "apt-get install libegl1 libgl1" in stderr
    assert "Traceback" not in stderr


@pytest.mark.usefixtures("graphics")
def test_robot_on_the_wall_clock_has_a_robots_camera_topics(start: Callable[..., Any]) -> None:
    _, client = start("--world", "walled", "--wall-clock")
    jpeg = client.next_message(graph.compressed(graph.BODY_IMAGE_ROBOT))
    assert jpeg.header.stamp.sec > 1_700_000_000
    topics = dict(client.node.get_topic_names_and_types())
    assert graph.GRIPPER_IMAGE.name in topics and graph.BODY_IMAGE_SIM.name not in topics


def test_speed_zero_runs_faster_than_the_wall_clock(start: Callable[..., Any]) -> None:
    _, client = start("--world", "walled", "--no-cameras", "--speed", "0")
    stamps = []
    for _ in range(4):
        # Twenty scans are two simulated seconds.
        for _ in range(20):
            scan = client.next_message(graph.SCAN)
        stamps.append(scan.header.stamp.sec)
    assert stamps[-1] - stamps[0] >= 5


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--world", "atlantis"), "expected demo"),
        (("--world", "/nowhere/layout.json"), "cannot be read"),
        (("--led-order", "XYZ"), "permutation of RGB"),
        (("--fidelity", "perfect"), "invalid choice"),
        (("--controllers", "broken"), "invalid choice"),
    ],
)
def test_invalid_arguments_end_with_status_2(arguments: tuple[str, str], text: str) -> None:
    process = subprocess.run(
        [sys.executable, "-m", "lupin_sim", *arguments], capture_output=True, text=True, timeout=60, check=False
    )
    assert process.returncode == 2
    assert text in process.stderr
    assert "Traceback" not in process.stderr


def test_run_directory_that_cannot_be_created_ends_with_status_2(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    process = subprocess.run(
        [sys.executable, "-m", "lupin_sim", "--no-cameras", "--run-dir", str(tmp_path / "file" / "run")],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert process.returncode == 2
    assert "cannot be created" in process.stderr


@pytest.mark.usefixtures("private_graph")
def test_failed_simulation_ends_its_process() -> None:
    """A robot with failed physics must not look alive."""
    script = """
import sys
from lupin_sim.engine import Simulation
from lupin_sim.__main__ import main
step = Simulation.step
def fail(self):
    step(self)
    if self.tick == 50:
        raise RuntimeError("physics failed")
Simulation.step = fail
sys.exit(main(["--no-cameras", "--world", "walled"]))
"""
    process = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=False)
    assert process.returncode == 1
    assert "physics failed" in process.stderr
