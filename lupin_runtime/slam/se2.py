"""Plane poses as arrays (x, y, yaw), meters and radians."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]


def wrap(angle: Array) -> Array:
    """The same directions within [-pi, pi)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def relative_pose(frm: Array, to: Array) -> Array:
    """Return the pose `to` (3,) in the frame of `frm` (3,)."""
    c, s = np.cos(frm[2]), np.sin(frm[2])
    dx, dy = to[0] - frm[0], to[1] - frm[1]
    return np.array([c * dx + s * dy, -s * dx + c * dy, float(wrap(to[2] - frm[2]))])


def compose(base: Array, motion: Array) -> Array:
    """Return `base` (3,) followed by `motion` (3,) in its frame."""
    c, s = np.cos(base[2]), np.sin(base[2])
    return np.array(
        [
            base[0] + c * motion[0] - s * motion[1],
            base[1] + s * motion[0] + c * motion[1],
            float(wrap(base[2] + motion[2])),
        ]
    )


def rotate_information(information: Array, yaw: float) -> Array:
    """Rotate an information (or covariance) matrix (3, 3) over (x, y, yaw) from map axes to those of a frame at `yaw`."""
    c, s = np.cos(yaw), np.sin(yaw)
    rotation = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(rotation @ information @ rotation.T)
