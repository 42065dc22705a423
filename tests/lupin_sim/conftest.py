"""Fixtures of the simulator's tests: simulations that a test steps itself, and simulated robots as processes."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from lupin_runtime.geometry import Pose2, wrap_angle
from lupin_sim.cameras import CameraRig, new_image
from lupin_sim.engine import Simulation
from lupin_sim.graphics import DISABLED
from lupin_sim.worlds import load_world
from tests.support.waiting import WAIT_S, wait_until

if TYPE_CHECKING:
    from nav_msgs.msg import Odometry

    from lupin_runtime import graph
    from lupin_sim.world import Tag, World


def _drive(simulation: Simulation, twist: tuple[float, float, float], seconds: float) -> None:
    """Command a twist at 20 Hz, as the drive bus does, for `seconds` of simulated time."""
    for tick in range(round(seconds * 100)):
        if tick % 5 == 0:
            simulation.command_twist(*twist)
        simulation.step()


def _rest(simulation: Simulation, seconds: float) -> None:
    """Step for `seconds` of simulated time without a command."""
    for _ in range(round(seconds * 100)):
        simulation.step()


def _in_front_of(tag: Tag, standoff_m: float = 0.5, left_m: float = 0.0, turn_rad: float = 0.0) -> Pose2:
    """Return the pose of a robot that looks at a tag from `standoff_m` in front of it.

    `left_m` is an offset to the left as seen from the tag, `turn_rad` a deviation of the heading.
    """
    x, y = tag.pose.apply(standoff_m, left_m)
    return Pose2(x, y, wrap_angle(tag.yaw + math.pi + turn_rad))


class Camera:
    """A simulation with a renderer for the robot's cameras."""

    def __init__(self, world: World) -> None:
        self.world, self.simulation = world, Simulation(world)
        self._rig = CameraRig(self.simulation.model)

    def capture(self, camera: str, pose: Pose2, arm: tuple[float, ...] | None = None) -> np.ndarray:
        """Return the image of a camera with the robot at a pose: BGR of shape (480, 640, 3)."""
        self.simulation.place(pose, arm)
        image = new_image()
        self._rig.render(self.simulation.data, camera, image)
        return image[:, :, ::-1].copy()

    def close(self) -> None:
        self._rig.close()


@pytest.fixture
def drive() -> Callable[..., Any]:
    return _drive


@pytest.fixture
def rest() -> Callable[..., Any]:
    return _rest


@pytest.fixture
def in_front_of() -> Callable[..., Any]:
    return _in_front_of


@pytest.fixture(scope="session")
def graphics() -> None:
    """Skips the test on a machine without OpenGL."""
    if os.environ["MUJOCO_GL"] == DISABLED:
        pytest.skip("needs OpenGL: apt-get install libegl1 libgl1")


@pytest.fixture(scope="module")
def demo_camera(graphics: None) -> Iterator[Any]:  # noqa: ARG001 -- the fixture must have run
    camera = Camera(load_world("demo"))
    yield camera
    camera.close()


@pytest.fixture
def simulation() -> Simulation:
    return Simulation(load_world("demo"))


class RobotProcess:
    """A simulated robot as a process: `python -m lupin_sim ARGUMENTS`."""

    def __init__(self, *arguments: str, **environment: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "lupin_sim", *arguments],
            env={**os.environ, **environment},
            stderr=subprocess.PIPE,
            text=True,
        )

    def stop(self) -> tuple[int, str]:
        """Stop it with SIGTERM, as the supervisor does. Returns its exit status and standard error."""
        self.process.send_signal(signal.SIGTERM)
        try:
            _, stderr = self.process.communicate(timeout=60)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.communicate()
            raise
        return self.process.returncode, stderr


class GraphClient:
    """A node on the robot's graph that keeps the newest message of each topic it subscribes to."""

    def __init__(self) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor

        from lupin_runtime.ros import LupinNode

        rclpy.init(args=[])
        self._shutdown = rclpy.shutdown
        self.node = LupinNode("test_client")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self.newest: dict[str, Any] = {}
        self.count: dict[str, int] = {}

    def subscribe(self, *rows: graph.Topic) -> None:
        for row in rows:
            if row.name not in self.count:
                self.count[row.name] = 0
                self.node.subscription(row, lambda message, name=row.name: self._take(name, message))  # type: ignore[misc]

    def _take(self, name: str, message: object) -> None:
        self.newest[name] = message
        self.count[name] += 1

    def spin_until(self, condition: Callable[..., Any], what: str, timeout_s: float = WAIT_S) -> Odometry | bool | int:
        """Spin until a condition is true, and return its value; fails the test after `timeout_s`."""
        value: Odometry | bool | int = wait_until(
            condition, what, timeout_s, interval_s=0.0, each=lambda: self._executor.spin_once(timeout_sec=0.05)
        )
        return value

    def next_message(self, row: graph.Topic) -> Any:
        """Wait for the next message of a topic."""
        self.subscribe(row)
        before = self.count[row.name]
        self.spin_until(lambda: self.count[row.name] > before, f"a message on {row.name}")
        return self.newest[row.name]

    def call(self, row: graph.Service, request: pytest.FixtureRequest) -> Any:
        client = self.node.client(row)
        self.spin_until(client.service_is_ready, f"{row.name}")
        future = client.call_async(request)
        self.spin_until(future.done, f"a reply of {row.name}")
        self.node.destroy_client(client)
        return future.result()

    def result(self, future: Any) -> Any:
        self.spin_until(future.done, "a result")
        return future.result()

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        self._shutdown()


@pytest.fixture(scope="session")
def start_robot(private_graph: int) -> type[Any]:  # noqa: ARG001 -- the fixture must have run
    """A function that starts `python -m lupin_sim` with arguments, in the DDS domain of this test run."""
    return RobotProcess


@pytest.fixture(scope="session")
def join_graph(private_graph: int) -> type[Any]:  # noqa: ARG001 -- the fixture must have run
    """A function that joins the graph of this test run."""
    return GraphClient
