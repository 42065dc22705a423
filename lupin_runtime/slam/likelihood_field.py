"""The likelihood of a beam's end point, by its distance to the nearest obstacle of a saved map (Thrun et al. 2005, 6.4)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from lupin_runtime.gridmap import GridMap
from lupin_runtime.slam import kernels

Array = NDArray[np.floating]

# Cells of a saved map with at least this occupancy are obstacles, as in map_server's default threshold.
OCCUPIED_FROM = 65
# The C kernel stores distances as eighths of a cell in one byte (255: beyond).
_STEPS_PER_CELL = 8.0

# Of refine_on_field. Steps are in m and rad.
_MAX_ITERATIONS = 12
_MAX_STEP, _CONVERGED_STEP = 0.1, 1e-4
_DAMPING = 1e-9  # keeps the system solvable where neither the points nor the prior determine the pose
_OUTLIER_M = 0.3  # points at least this far from every obstacle are ignored
_CAUCHY_SIGMAS = 2.0  # scale of the loss
_NEAR_M = 0.1  # points nearer than this count in the returned share


@dataclass(frozen=True)
class LikelihoodFieldParameters:
    """Parameters of AMCL's likelihood-field sensor model, as in Nav2."""

    z_hit: float = 0.5  # weight of a hit
    z_rand: float = 0.5  # weight of a random measurement
    sigma_hit_m: float = 0.2  # standard deviation of a hit
    max_distance_m: float = 2.0  # cap of the distance to an obstacle
    range_max_m: float = 12.0  # a random measurement is equally likely up to this range


class LikelihoodField:
    """Distances to the nearest obstacle of a map: quantised for scoring particles, bilinear for refinement."""

    def __init__(self, grid: GridMap, parameters: LikelihoodFieldParameters | None = None) -> None:
        self.parameters = parameters or LikelihoodFieldParameters()
        self.grid = grid
        occupied = grid.cells >= OCCUPIED_FROM
        cells = distance_transform_edt(~occupied) if occupied.any() else np.full(grid.cells.shape, 1e6)
        self.distance_m: Array = np.minimum(cells * grid.resolution_m, self.parameters.max_distance_m)
        self._distance_eighths = np.ascontiguousarray(np.minimum(np.rint(cells * _STEPS_PER_CELL), 255).astype(np.uint8))
        steps = np.arange(256) * grid.resolution_m / _STEPS_PER_CELL
        steps[255] = self.parameters.max_distance_m
        hit = self.parameters.z_hit * np.exp(-(steps**2) / (2.0 * self.parameters.sigma_hit_m**2))
        self._table: Array = np.log(hit + self.parameters.z_rand / self.parameters.range_max_m)

    def log_likelihood(self, particles: Array, points: Array) -> Array:
        """Log likelihood (n,) of points (b, 2), in the robot's frame, for particles (n, 3)."""
        corner = (self.grid.origin_x, self.grid.origin_y)
        return kernels.particle_scores(particles, points, self._distance_eighths, corner, self.grid.resolution_m, self._table)

    def sample(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """Distance (n,) m at points of the map and its gradient, bilinear between the centers of cells.

        Points outside the map are as far from every obstacle as the cap.
        """
        h, w = self.distance_m.shape
        u = (x - self.grid.origin_x) / self.grid.resolution_m - 0.5
        v = (y - self.grid.origin_y) / self.grid.resolution_m - 0.5
        outside = (u < -0.5) | (v < -0.5) | (u > w - 0.5) | (v > h - 0.5)
        u, v = np.clip(u, 0.0, w - 1.001), np.clip(v, 0.0, h - 1.001)
        i, j = u.astype(int), v.astype(int)
        fu, fv = u - i, v - j
        d00, d01 = self.distance_m[j, i], self.distance_m[j, np.minimum(i + 1, w - 1)]
        d10 = self.distance_m[np.minimum(j + 1, h - 1), i]
        d11 = self.distance_m[np.minimum(j + 1, h - 1), np.minimum(i + 1, w - 1)]
        low, high = d00 + fu * (d01 - d00), d10 + fu * (d11 - d10)
        du = (1.0 - fv) * (d01 - d00) + fv * (d11 - d10)
        distance = np.where(outside, self.parameters.max_distance_m, low + fv * (high - low))
        gradient = 1.0 / self.grid.resolution_m
        return distance, np.where(outside, 0.0, du * gradient), np.where(outside, 0.0, (high - low) * gradient)


def refine_on_field(
    field: LikelihoodField, points: Array, pose: Array, prior: Array, prior_information: Array, sigma_m: float = 0.03
) -> tuple[Array, Array, float]:
    """Refine `pose` (3,) by Gauss-Newton on the points' distances to obstacles, with a Cauchy loss, and on a prior (3,).

    Returns (pose, information of the points alone, share of points near an obstacle).
    """
    pose = pose.copy()
    information = np.zeros((3, 3))
    near = 0.0
    for _ in range(_MAX_ITERATIONS):
        c, s = math.cos(pose[2]), math.sin(pose[2])
        lx, ly = c * points[:, 0] - s * points[:, 1], s * points[:, 0] + c * points[:, 1]
        d, gx, gy = field.sample(pose[0] + lx, pose[1] + ly)
        weight = np.where(d < _OUTLIER_M, 1.0 / ((1.0 + (d / (_CAUCHY_SIGMAS * sigma_m)) ** 2) * sigma_m**2), 0.0)
        jacobian = np.stack((gx, gy, gy * lx - gx * ly), axis=1)
        information = (jacobian * weight[:, None]).T @ jacobian
        error = pose - prior
        error[2] = (error[2] + math.pi) % (2.0 * math.pi) - math.pi
        gradient = jacobian.T @ (weight * d) + prior_information @ error
        step = np.linalg.solve(information + prior_information + np.eye(3) * _DAMPING, gradient)
        step = np.clip(step, -_MAX_STEP, _MAX_STEP)
        pose -= step
        near = float(np.mean(d < _NEAR_M)) if len(d) else 0.0
        if np.abs(step).max() < _CONVERGED_STEP:
            break
    return pose, information, near
