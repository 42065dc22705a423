"""Renders the images of the robot's two cameras."""

from __future__ import annotations

import os

import mujoco
import numpy as np
from numpy.typing import NDArray

from lupin_sim import mirte
from lupin_sim.graphics import DISABLED, NO_GRAPHICS

_EXPENSIVE_EFFECTS = (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION, mujoco.mjtRndFlag.mjRND_HAZE)


class GraphicsUnavailable(RuntimeError):
    """This machine cannot render; the message says what to install."""


class CameraRig:
    """One renderer for all cameras. Create, use and close it in one thread, which owns its OpenGL context."""

    def __init__(self, model: mujoco.MjModel) -> None:
        if os.environ.get("MUJOCO_GL", "").lower() in (DISABLED, "off", "0", "false"):
            raise GraphicsUnavailable(NO_GRAPHICS)
        try:
            self._renderer = mujoco.Renderer(model, mirte.IMAGE_HEIGHT, mirte.IMAGE_WIDTH)
        except Exception as error:
            # Without a driver, PyOpenGL raises one of several errors: AttributeError, ImportError, GLError, EGLError.
            raise GraphicsUnavailable(f"{NO_GRAPHICS} ({type(error).__name__}: {error})") from error
        for flag in _EXPENSIVE_EFFECTS:
            self._renderer.scene.flags[flag] = False

    def render(self, data: mujoco.MjData, camera: str, out: NDArray[np.uint8]) -> None:
        """Render a camera's view into `out`, RGB of shape (480, 640, 3). The kinematics of `data` must be up to date."""
        self._renderer.update_scene(data, camera=camera)
        self._renderer.render(out=out)

    def close(self) -> None:
        """Free the context; otherwise Mesa's software renderer raises at interpreter exit."""
        self._renderer.close()


def new_image() -> NDArray[np.uint8]:
    """Return an image buffer for `CameraRig.render`."""
    return np.zeros((mirte.IMAGE_HEIGHT, mirte.IMAGE_WIDTH, 3), np.uint8)
