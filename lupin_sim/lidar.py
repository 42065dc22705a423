"""The lidar: casts rays through the scene, adds noise and dropouts. Needs no graphics."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from lupin_sim import mirte
from lupin_sim.robot_model import LIDAR_SITE

ANGLE_MIN_RAD = -math.pi
ANGLE_STEP_RAD = 2 * math.pi / mirte.LIDAR_RAYS
NOISE_M, NOISE_PER_M = 0.005, 0.003
DROPOUT = 0.002
# Geom groups that a ray can hit: the world and its tags. The vendor's driver masks the robot's own pillars; so does this.
_VISIBLE = np.array([1, 1, 0, 0, 0, 0], np.uint8)


class Lidar:
    """Casts all rays of one revolution at once."""

    def __init__(self, model: mujoco.MjModel, rng: np.random.Generator) -> None:
        self._model = model
        self._rng = rng
        self._site = model.site(LIDAR_SITE).id
        angles = ANGLE_MIN_RAD + ANGLE_STEP_RAD * np.arange(mirte.LIDAR_RAYS)
        self._rays = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], 1)
        self._hit = np.zeros(mirte.LIDAR_RAYS, np.int32)
        self._range = np.zeros(mirte.LIDAR_RAYS)

    def true_ranges(self, data: mujoco.MjData) -> NDArray[np.float64]:
        """Noise-free ranges of shape (360,), meters in the frame `laser`; inf if nothing is within 12 m."""
        rotation = data.site_xmat[self._site].reshape(3, 3)
        rays = np.ascontiguousarray(self._rays @ rotation.T).ravel()
        mujoco.mj_multiRay(
            self._model,
            data,
            data.site_xpos[self._site],
            rays,
            _VISIBLE,
            1,
            -1,
            self._hit,
            self._range,
            None,
            mirte.LIDAR_RAYS,
            mirte.LIDAR_MAX_M,
        )
        return np.where(self._range < 0, np.inf, self._range)

    def scan(self, data: mujoco.MjData) -> NDArray[np.float32]:
        """Ranges of shape (360,) as the sensor reports them: with noise, in whole millimeters, inf for no return."""
        ranges = self.true_ranges(data)
        noise = self._rng.normal(size=ranges.shape)
        lost = self._rng.random(ranges.shape) < DROPOUT
        seen = np.isfinite(ranges)
        ranges[seen] += noise[seen] * (NOISE_M + NOISE_PER_M * ranges[seen])
        ranges = np.round(ranges, 3)
        ranges[lost | (ranges < mirte.LIDAR_MIN_M) | (ranges > mirte.LIDAR_MAX_M)] = np.inf
        return ranges.astype(np.float32)
