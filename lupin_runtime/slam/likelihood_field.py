"""How likely a beam ends where it does, by its distance to the nearest obstacle of a saved map (Thrun et al. 2005, 6.4)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from lupin_runtime.gridmap import GridMap
from lupin_runtime.slam import kernels

Array = NDArray[np.floating]

# Cells of a saved map count as obstacles from here on, as in map_server's default threshold.
OCCUPIED_FROM = 65
# The kernel's distances: eighths of a cell in a byte.
_PER_CELL = 8.0


@dataclass(frozen=True)
class BeamModel:
    """Nav2's likelihood field: weights of a hit and of noise, the hit's standard deviation, where distances are cut, m."""

    z_hit: float = 0.5
    z_rand: float = 0.5
    sigma_hit_m: float = 0.2
    max_distance_m: float = 2.0
    range_max_m: float = 12.0


class LikelihoodField:
    """Distances to the nearest obstacle of a map, for particles (coarse, fast) and for refinement (smooth)."""

    def __init__(self, grid: GridMap, model: BeamModel | None = None) -> None:
        self.model = model or BeamModel()
        self.grid = grid
        occupied = grid.cells >= OCCUPIED_FROM
        cells = distance_transform_edt(~occupied) if occupied.any() else np.full(grid.cells.shape, 1e6)
        self.distance_m: Array = np.minimum(cells * grid.resolution_m, self.model.max_distance_m)
        self._eighths = np.ascontiguousarray(np.minimum(np.rint(cells * _PER_CELL), 255).astype(np.uint8))
        steps = np.arange(256) * grid.resolution_m / _PER_CELL
        steps[255] = self.model.max_distance_m
        hit = self.model.z_hit * np.exp(-(steps**2) / (2.0 * self.model.sigma_hit_m**2))
        self._table: Array = np.log(hit + self.model.z_rand / self.model.range_max_m)

    def log_likelihood(self, particles: Array, points: Array) -> Array:
        """Log likelihood (n,) of points (b, 2), in the robot's frame, for particles (n, 3)."""
        corner = (self.grid.origin_x, self.grid.origin_y)
        return kernels.particle_scores(particles, points, self._eighths, corner, self.grid.resolution_m, self._table)

    def sample(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """Distance (n,) m at points of the map and its gradient, bilinear between the centres of cells."""
        h, w = self.distance_m.shape
        u = np.clip((x - self.grid.origin_x) / self.grid.resolution_m - 0.5, 0.0, w - 1.001)
        v = np.clip((y - self.grid.origin_y) / self.grid.resolution_m - 0.5, 0.0, h - 1.001)
        i, j = u.astype(int), v.astype(int)
        fu, fv = u - i, v - j
        d00, d01 = self.distance_m[j, i], self.distance_m[j, np.minimum(i + 1, w - 1)]
        d10 = self.distance_m[np.minimum(j + 1, h - 1), i]
        d11 = self.distance_m[np.minimum(j + 1, h - 1), np.minimum(i + 1, w - 1)]
        low, high = d00 + fu * (d01 - d00), d10 + fu * (d11 - d10)
        du = (1.0 - fv) * (d01 - d00) + fv * (d11 - d10)
        return low + fv * (high - low), du / self.grid.resolution_m, (high - low) / self.grid.resolution_m


def refine_on_field(
    field: LikelihoodField, points: Array, pose: Array, prior: Array, prior_information: Array, sigma_m: float = 0.03
) -> tuple[Array, Array, float]:
    """(pose, information of the points alone, share of points near an obstacle) by Gauss-Newton from `pose` (3,).

    Distances are residuals under a Cauchy kernel, `prior` (3,) with its information pulls.
    """
    pose = pose.copy()
    information = np.zeros((3, 3))
    near = 0.0
    for _ in range(12):
        c, s = math.cos(pose[2]), math.sin(pose[2])
        lx, ly = c * points[:, 0] - s * points[:, 1], s * points[:, 0] + c * points[:, 1]
        d, gx, gy = field.sample(pose[0] + lx, pose[1] + ly)
        weight = np.where(d < 0.3, 1.0 / ((1.0 + (d / (2.0 * sigma_m)) ** 2) * sigma_m**2), 0.0)
        jacobian = np.stack((gx, gy, gy * lx - gx * ly), axis=1)
        information = (jacobian * weight[:, None]).T @ jacobian
        error = pose - prior
        error[2] = (error[2] + math.pi) % (2.0 * math.pi) - math.pi
        gradient = jacobian.T @ (weight * d) + prior_information @ error
        step = np.linalg.solve(information + prior_information + np.eye(3) * 1e-9, gradient)
        step = np.clip(step, -0.1, 0.1)
        pose -= step
        near = float(np.mean(d < 0.1)) if len(d) else 0.0
        if np.abs(step).max() < 1e-4:
            break
    return pose, information, near
