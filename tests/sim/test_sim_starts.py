"""Other ways to start the simulated robot, and starts that are refused."""

from __future__ import annotations

import subprocess
import sys

import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install ./interfaces")

from controller_manager_msgs.srv import ConfigureController, ListControllers, SwitchController

from lupin_runtime import graph

pytestmark = [pytest.mark.graph, pytest.mark.sim]


@pytest.fixture
def meet(start_robot, start_stranger):
    """Start a robot, join its graph; at the end the robot must go quietly."""
    met = []

    def start(*arguments, **environment):
        met.append((start_robot(*arguments, **environment), start_stranger()))
        met[-1][1].fresh(graph.CLOCK)
        return met[-1]

    yield start
    for robot, stranger in met:
        stranger.close()
        if robot.process.poll() is None:
            assert robot.stop()[0] == 0


def test_unconfigured_controllers_say_nothing_until_they_are_healed(meet):
    _, stranger = meet("--world", "walled", "--no-cameras", "--controllers", "unconfigured")
    stranger.listen(graph.JOINT_STATES, graph.ODOM)
    stranger.fresh(graph.SCAN)
    stranger.fresh(graph.SCAN)
    assert stranger.count[graph.JOINT_STATES.name] == stranger.count[graph.ODOM.name] == 0
    listed = stranger.call(graph.LIST_CONTROLLERS, ListControllers.Request()).controller
    assert {c.state for c in listed} == {"unconfigured"}
    for name in graph.CONTROLLERS:
        assert stranger.call(graph.CONFIGURE_CONTROLLER, ConfigureController.Request(name=name)).ok
    request = SwitchController.Request(activate_controllers=list(graph.CONTROLLERS), strictness=1)
    assert stranger.call(graph.SWITCH_CONTROLLER, request).ok
    stranger.fresh(graph.JOINT_STATES)
    stranger.fresh(graph.ODOM)


def test_without_graphics_the_robot_runs_and_says_what_to_install(meet):
    robot, stranger = meet("--world", "walled", MUJOCO_GL="disable")
    stranger.fresh(graph.SCAN)
    stranger.fresh(graph.ODOM)
    status, complaints = robot.stop()
    assert status == 0
    assert "apt-get install libegl1 libgl1" in complaints
    assert "Traceback" not in complaints


def test_simulated_time_may_run_faster_than_the_wall_clock(meet):
    _, stranger = meet("--world", "walled", "--no-cameras", "--speed", "0")
    stamps = []
    for _ in range(4):
        # Twenty scans are two simulated seconds.
        for _ in range(20):
            scan = stranger.fresh(graph.SCAN)
        stamps.append(scan.header.stamp.sec)
    assert stamps[-1] - stamps[0] >= 5


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--world", "atlantis"), "there are demo"),
        (("--world", "/nowhere/layout.json"), "cannot be read"),
        (("--led-order", "XYZ"), "permutation of RGB"),
        (("--fidelity", "perfect"), "invalid choice"),
        (("--controllers", "broken"), "invalid choice"),
    ],
)
def test_arguments_that_make_no_simulation_end_with_status_2(arguments, text):
    ended = subprocess.run(
        [sys.executable, "-m", "lupin_sim", *arguments], capture_output=True, text=True, timeout=30, check=False
    )
    assert ended.returncode == 2
    assert text in ended.stderr
    assert "Traceback" not in ended.stderr


def test_a_run_directory_that_cannot_be_made_ends_with_status_2(tmp_path):
    (tmp_path / "file").write_text("")
    ended = subprocess.run(
        [sys.executable, "-m", "lupin_sim", "--no-cameras", "--run-dir", str(tmp_path / "file" / "run")],
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
    )
    assert ended.returncode == 2
    assert "cannot be made" in ended.stderr


def test_a_world_that_fails_takes_its_process_along(private_graph):
    """A robot whose physics died must not go on looking alive."""
    script = """
import sys
from lupin_sim.engine import Simulation
from lupin_sim.__main__ import main
step = Simulation.step
def fail(self):
    step(self)
    if self.tick == 50:
        raise RuntimeError("the floor gave way")
Simulation.step = fail
sys.exit(main(["--no-cameras", "--world", "walled"]))
"""
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=30, check=False)
    assert ended.returncode == 1
    assert "the floor gave way" in ended.stderr
