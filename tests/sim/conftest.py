"""The simulator's tests step worlds by hand, so nothing here waits for a clock."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from lupin_runtime import graph
from lupin_runtime.geometry import Pose2, wrap_angle
from lupin_sim.cameras import CameraRig, new_image
from lupin_sim.engine import Simulation
from lupin_sim.graphics import DISABLED
from lupin_sim.world import Tag, World
from lupin_sim.worlds import load_world

DEADLINE_S = 20.0


def _drive(simulation: Simulation, twist: tuple[float, float, float], seconds: float) -> None:
    """Command a twist at 20 Hz for a while, as the drive bus does."""
    for tick in range(round(seconds * 100)):
        if tick % 5 == 0:
            simulation.command_twist(*twist)
        simulation.step()


def _rest(simulation: Simulation, seconds: float) -> None:
    """Let time pass without a command."""
    for _ in range(round(seconds * 100)):
        simulation.step()


def _in_front_of(tag: Tag, standoff_m: float = 0.5, left_m: float = 0.0, turn_rad: float = 0.0) -> Pose2:
    """Where the robot stands to look at a tag, `left_m` to the left of one who looks out of its box."""
    x, y = tag.pose.apply(standoff_m, left_m)
    return Pose2(x, y, wrap_angle(tag.yaw + math.pi + turn_rad))


class Eyes:
    """A simulation with a renderer."""

    def __init__(self, world: World) -> None:
        self.world, self.simulation = world, Simulation(world)
        self._rig = CameraRig(self.simulation.model)

    def look(self, camera: str, pose: Pose2, arm: tuple[float, ...] | None = None) -> np.ndarray:
        """What a camera sees from a pose: BGR of shape (480, 640, 3)."""
        self.simulation.place(pose, arm)
        image = new_image()
        self._rig.render(self.simulation.data, camera, image)
        return image[:, :, ::-1].copy()

    def close(self) -> None:
        self._rig.close()


@pytest.fixture
def drive():
    return _drive


@pytest.fixture
def rest():
    return _rest


@pytest.fixture
def in_front_of():
    return _in_front_of


@pytest.fixture(scope="session")
def graphics():
    """Skips where nothing can be drawn."""
    if os.environ["MUJOCO_GL"] == DISABLED:
        pytest.skip("needs OpenGL: apt-get install libegl1 libgl1")


@pytest.fixture(scope="module")
def demo_eyes(graphics):
    eyes = Eyes(load_world("demo"))
    yield eyes
    eyes.close()


@pytest.fixture
def simulation() -> Simulation:
    return Simulation(load_world("demo"))


class Robot:
    """A simulation of its own in a process."""

    def __init__(self, *arguments: str, **environment: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "lupin_sim", *arguments],
            env={**os.environ, **environment},
            stderr=subprocess.PIPE,
            text=True,
        )

    def stop(self) -> tuple[int, str]:
        """End it as the supervisor does; its exit status and what it complained about."""
        self.process.send_signal(signal.SIGTERM)
        try:
            _, complaints = self.process.communicate(timeout=10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.communicate()
            raise
        return self.process.returncode, complaints


class Stranger:
    """Somebody on the graph with the newest message of every topic that was asked for."""

    def __init__(self) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor

        from lupin_runtime.ros import LupinNode

        rclpy.init(args=[])
        self._shutdown = rclpy.shutdown
        self.node = LupinNode("stranger")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self.newest: dict[str, object] = {}
        self.count: dict[str, int] = {}

    def listen(self, *rows: graph.Topic) -> None:
        for row in rows:
            if row.name not in self.count:
                self.count[row.name] = 0
                self.node.subscription(row, lambda message, name=row.name: self._take(name, message))

    def _take(self, name: str, message: object) -> None:
        self.newest[name] = message
        self.count[name] += 1

    def until(self, condition, what: str, bound_s: float = DEADLINE_S):
        end = time.monotonic() + bound_s
        while not (value := condition()):
            assert time.monotonic() < end, f"{what} did not happen within {bound_s} s"
            self._executor.spin_once(timeout_sec=0.05)
        return value

    def fresh(self, row: graph.Topic):
        """The next message of a topic."""
        self.listen(row)
        before = self.count[row.name]
        self.until(lambda: self.count[row.name] > before, f"a message on {row.name}")
        return self.newest[row.name]

    def call(self, row: graph.Service, request):
        client = self.node.client(row)
        self.until(client.service_is_ready, f"{row.name}")
        future = client.call_async(request)
        self.until(future.done, f"an answer of {row.name}")
        self.node.destroy_client(client)
        return future.result()

    def wait(self, future):
        self.until(future.done, "an answer")
        return future.result()

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        self._shutdown()


@pytest.fixture(scope="session")
def start_robot(private_graph):
    """Starts `python -m lupin_sim` with arguments, in this test run's own domain."""
    return Robot


@pytest.fixture(scope="session")
def start_stranger(private_graph):
    """Joins the graph."""
    return Stranger
