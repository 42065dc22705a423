"""Scan matching: a correlative search over a window of poses, then point-to-line refinement below the size of a cell.

The search is Olson's (ICRA 2009) with branch and bound over a max-pooled field; the refinement is Gauss-Newton on the distances
to surfels, with the odometry as prior. Its covariance is widened, since the errors of beams on one wall are correlated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.slam import kernels
from lupin_runtime.slam.local_map import LocalMap
from lupin_runtime.slam.scan import ScanPoints

Array = NDArray[np.floating]

# Beams on one wall share its errors: this many beams count as one independent measurement.
BEAMS_PER_MEASUREMENT = 6.0
# No match is better than this, whatever its residuals: map and clock have errors of their own (m, m, rad).
FLOOR = np.diag([0.003**2, 0.003**2, 0.0012**2])
# The share of the mean score that one standard deviation from the prior costs: it decides along a bare corridor.
PRIOR_WEIGHT = 0.004


@dataclass(frozen=True)
class Window:
    """The poses to search: half the width in meters, half the range of yaw in radians."""

    half_m: float
    half_rad: float


@dataclass(frozen=True)
class Match:
    """A pose that a scan fits.

    `pose` (3,), `information` (3, 3) of the scan alone in the map's axes, `score` 0 to 1 of the field, `overlap` the share
    of points that met a surface, `fit` the share of those within 3 sigma, `residual_m` their mean distance.
    """

    pose: Array
    information: Array
    score: float
    overlap: float
    fit: float
    residual_m: float

    @property
    def covariance(self) -> Array:
        """The covariance (3, 3) of the scan alone; huge along directions that it does not constrain."""
        return np.asarray(np.linalg.inv(self.information + np.eye(3) * 1e-4)) + FLOOR


def match(
    local: LocalMap, scan: ScanPoints, guess: Array, covariance: Array, window: Window | None, min_score: float = 0.0,
    prior_weight: float = PRIOR_WEIGHT, points: Array | None = None,
) -> Match | None:  # fmt: skip
    """Fit `scan` into `local` near `guess` (3,) of `covariance` (3, 3); None if no pose scores `min_score`.

    Without a window only the refinement runs. `points` (n, 2) replaces the scan's own in the search.
    """
    start = guess
    points = scan.thinned(local.shape.cell_m) if points is None else points
    if window is not None:
        found = search(local, points, guess, covariance, window, min_score, prior_weight)
        if found is None:
            return None
        start = found[1]
    return refine(local, scan, start, guess, covariance, points)


def search(
    local: LocalMap, points: Array, guess: Array, covariance: Array, window: Window, min_score: float,
    prior_weight: float, avoid: Sequence[Array] = (), avoid_reach: Window = Window(0.5, 0.25),
) -> tuple[float, Array] | None:  # fmt: skip
    """Find (score, pose) of the best pose of the window on the grid of cells.

    `avoid` excludes the surroundings of poses (3,), to find the second best.
    """
    cell = local.shape.cell_m
    distance = np.hypot(points[:, 0], points[:, 1])
    far = max(1.0, float(np.partition(distance, int(0.9 * len(distance)))[int(0.9 * len(distance))])) if len(distance) else 1.0
    half = max(1, math.ceil(window.half_m / cell))
    step = min(0.05, cell / far)
    turns = max(1, math.ceil(window.half_rad / step))
    offsets = np.arange(-turns, turns + 1) * step
    penalty = prior_weight * offsets**2 / max(float(covariance[2, 2]), 1e-8)
    spread = max(0.5 * float(covariance[0, 0] + covariance[1, 1]), 1e-8)
    levels = min(local.shape.levels, max(1, int(math.log2(half)) - 1))
    masks = np.array(
        [
            (
                round(((pose[2] - guess[2] + math.pi) % (2 * math.pi) - math.pi) / step) + turns,
                round((pose[0] - guess[0]) / cell),
                round((pose[1] - guess[1]) / cell),
                math.ceil(avoid_reach.half_rad / step),
                math.ceil(avoid_reach.half_m / cell),
            )
            for pose in avoid
        ],
        np.int32,
    ).reshape(-1, 5)
    found = kernels.search_window(
        local.pyramid(levels), local.corner, cell, points, (float(guess[0]), float(guess[1])), guess[2] + offsets,
        penalty, half, prior_weight * cell * cell / spread, min_score, masks,
    )  # fmt: skip
    if found is None:
        return None
    score, turn, columns, rows = found
    return score, np.array([guess[0] + columns * cell, guess[1] + rows * cell, guess[2] + offsets[turn]])


def refine(local: LocalMap, scan: ScanPoints, start: Array, prior: Array, covariance: Array, points: Array) -> Match:
    """Gauss-Newton from `start`, pulled towards `prior` (3,) by `covariance` (3, 3)."""
    weight = np.linalg.inv(covariance) * BEAMS_PER_MEASUREMENT
    pose, information, partners, inliers, residual = kernels.refine_pose(
        scan.xy, scan.normal, scan.sigma, local.slot, local.surfel, local.corner, local.shape.cell_m, local.size, start, prior,
        weight, 12, 0.15, 0.10,
    )  # fmt: skip
    return Match(
        pose,
        information / BEAMS_PER_MEASUREMENT,
        kernels.field_score(local.field, local.corner, local.shape.cell_m, points, pose),
        partners / max(len(scan), 1),
        inliers / max(partners, 1),
        residual,
    )
