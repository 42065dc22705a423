"""The choice of the graphics backend, and that rendering disturbs nothing."""

from __future__ import annotations

import ctypes
from typing import Any

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
        ({"libEGL.so.1", "libOSMesa.so.8"}, "osmesa"),  # EGL without OpenGL cannot render
        ({"libOSMesa.so.6"}, "osmesa"),
        (set(), "disable"),
    ],
)
def test_backend_is_chosen_by_the_libraries_present(monkeypatch: pytest.MonkeyPatch, present: set[Any], backend: str) -> None:
    def load(name: str) -> None:
        if name not in present:
            raise OSError(name)

    monkeypatch.setattr(ctypes, "CDLL", load)
    assert chooser.usable_backend() == backend


def test_missing_graphics_error_names_the_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "disable")
    with pytest.raises(GraphicsUnavailable, match="apt-get install libegl1 libgl1"):
        CameraRig(Simulation(load_world("walled")).model)


@pytest.mark.usefixtures("graphics")
def test_rendering_is_repeatable_and_changes_no_state() -> None:
    """Two equal drives, the second with an image every tenth tick, have the same last image and state."""
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
    assert np.array_equal(*frames)  # type: ignore[arg-type]
    assert np.array_equal(*states)
