import ctypes

import numpy as np
import pytest

from lupin_sim import graphics as chooser
from lupin_sim.cameras import CameraRig, GraphicsUnavailable, new_image
from lupin_sim.engine import Simulation
from lupin_sim.worlds import load_world


@pytest.mark.parametrize(
    ("present", "backend"),
    [
        ({"libEGL.so.1", "libGL.so.1"}, "egl"),
        ({"libEGL.so.1", "libOpenGL.so.0", "libOSMesa.so.8"}, "egl"),
        ({"libEGL.so.1", "libOSMesa.so.8"}, "osmesa"),  # EGL without OpenGL draws nothing
        ({"libOSMesa.so.6"}, "osmesa"),
        (set(), "disable"),
    ],
)
def test_the_backend_follows_from_the_libraries_that_open(monkeypatch, present, backend):
    def opens(name):
        if name not in present:
            raise OSError(name)

    monkeypatch.setattr(ctypes, "CDLL", opens)
    assert chooser.usable_backend() == backend


def test_without_graphics_the_reason_names_the_packages(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "disable")
    with pytest.raises(GraphicsUnavailable, match="apt-get install libegl1 libgl1"):
        CameraRig(Simulation(load_world("walled")).model)


def test_pictures_repeat_bit_for_bit_and_look_at_nothing_else(graphics):
    """Twice the same drive, once with pictures taken at every tenth tick only in the second: same frame, same state."""
    frames, states = [], []
    for often in (False, True):
        simulation = Simulation(load_world("walled"))
        rig, image = CameraRig(simulation.model), new_image()
        for tick in range(100):
            simulation.command_twist(0.2, 0.0, 0.3)
            simulation.step()
            if often and tick % 10 == 0:
                rig.render(simulation.data, "gripper_camera", image)
        rig.render(simulation.data, "body_camera", image)
        frames.append(image.copy())
        states.append(simulation.data.qpos.copy())
        rig.close()
    assert np.array_equal(*frames)
    assert np.array_equal(*states)
