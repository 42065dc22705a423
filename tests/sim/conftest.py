"""The simulator's tests step worlds by hand, so nothing here waits for a clock."""

from __future__ import annotations

import math
import os

import numpy as np
import pytest

from lupin_runtime.geometry import Pose2, wrap_angle
from lupin_sim.cameras import CameraRig, new_image
from lupin_sim.engine import Simulation
from lupin_sim.graphics import DISABLED
from lupin_sim.world import Tag, World
from lupin_sim.worlds import load_world


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
