"""Which OpenGL this machine has for drawing without a screen. Physics and lidar need none."""

from __future__ import annotations

import ctypes

NO_GRAPHICS = (
    "no OpenGL found, so the cameras stay dark (physics, lidar and everything else run); "
    "install it with: apt-get install libegl1 libgl1"
)
DISABLED = "disable"
# Backend of MuJoCo and the libraries that it opens, each with the names that a distribution may give it.
_BACKENDS = (
    ("egl", (("libEGL.so.1",), ("libGL.so.1", "libOpenGL.so.0"))),
    ("osmesa", (("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so"),)),
)


def usable_backend() -> str:
    """A value for MUJOCO_GL: `egl`, else `osmesa`, else `disable`."""
    for backend, libraries in _BACKENDS:
        if all(any(_opens(name) for name in names) for names in libraries):
            return backend
    return DISABLED


def _opens(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True
