"""Finds an OpenGL library for rendering without a screen. Physics and lidar need none."""

from __future__ import annotations

import ctypes

NO_GRAPHICS = (
    "no OpenGL found, so there are no camera images (physics, lidar and everything else run); "
    "install it with: apt-get install libegl1 libgl1"
)
DISABLED = "disable"
# MuJoCo's backends with the libraries that each needs, and the file names of a library.
_BACKENDS = (
    ("egl", (("libEGL.so.1",), ("libGL.so.1", "libOpenGL.so.0"))),
    ("osmesa", (("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so"),)),
)


def usable_backend() -> str:
    """Return the value for MUJOCO_GL: the first usable of `egl` and `osmesa`, else `disable`."""
    for backend, libraries in _BACKENDS:
        if all(any(_can_load(name) for name in names) for names in libraries):
            return backend
    return DISABLED


def _can_load(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True
