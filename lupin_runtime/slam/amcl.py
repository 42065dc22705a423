"""Adaptive Monte Carlo localization on a saved map: particles show where the robot may be, a refinement gives the exact pose.

Motion and sensor models are Nav2's omni model and likelihood field (Thrun, Burgard, Fox 2005, 5.4, 6.4, 8.3); the number of
particles follows Fox's KLD bound (2003). The published covariance is honest: particles alone are too thinned to measure
centimeters, so the refined pose has the information of its scan, and the cloud's spread in directions without information.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.gridmap import GridMap
from lupin_runtime.slam.likelihood_field import LikelihoodField, LikelihoodFieldParameters, refine_on_field
from lupin_runtime.slam.se2 import wrap

Array = NDArray[np.floating]

# Beams on one wall share its errors, and a grid has cells: this many beams count as one independent measurement.
BEAMS_PER_MEASUREMENT = 4.0
# No pose on a grid of 5 cm cells is more exact than this (m, m, rad).
FLOOR = np.diag([0.012**2, 0.012**2, 0.004**2])
# Minimum effective share of particles after a scan; maximum number of parts of a scan; maximum width of the kernel (m, m, rad).
MIN_EFFECTIVE_SHARE, MAX_PARTS = 0.05, 12
KERNEL = np.array([0.15, 0.15, 0.1])
# The refinement of the likeliest particle, by which the explained share is measured, stays this near to it (m, m, rad).
LIKELIEST_SIGMA = np.array([0.15, 0.15, 0.1])
# Bins of the KLD bound: Nav2's, m and rad.
_BIN = np.array([0.5, 0.5, math.radians(10.0)])


@dataclass(frozen=True)
class AmclSettings:
    """Nav2's parameters of the same names; a refinement is accepted if at least the share `min_near_share` of beams fits."""

    alpha: tuple[float, float, float, float, float] = (0.2, 0.2, 0.2, 0.2, 0.2)
    min_particles: int = 500
    max_particles: int = 2000
    max_beams: int = 60
    update_min_d: float = 0.25
    update_min_a: float = 0.2
    resample_interval: int = 1
    pf_err: float = 0.05
    pf_z: float = 2.33  # the upper quantile at 0.99
    likelihood_field: LikelihoodFieldParameters = field(default_factory=LikelihoodFieldParameters)
    min_near_share: float = 0.55


@dataclass(frozen=True)
class Belief:
    """Where the robot is: pose (3,) and covariance (3, 3) in the map; `refined` if a scan determined the pose.

    `explained` is the share of the scan's end points that are near an obstacle of the map; None without a scan.
    """

    pose: Array
    covariance: Array
    refined: bool
    explained: float | None = None


def _scaled(weights: Array, log_likelihood: Array, exponent: float) -> Array:
    """Multiply weights (n,) by a power of the likelihood, and normalize."""
    score = np.log(np.maximum(weights, 1e-300)) + exponent * log_likelihood
    scaled = np.exp(score - score.max())
    return np.asarray(scaled / scaled.sum())


def _effective_size(weights: Array) -> float:
    """The effective sample size: the number of equally weighted particles with the same information."""
    return 1.0 / float(weights @ weights)


class Amcl:
    """A particle filter over poses in a map."""

    def __init__(self, grid: GridMap, settings: AmclSettings | None = None, seed: int = 0) -> None:
        self.settings = settings or AmclSettings()
        self.field = LikelihoodField(grid, self.settings.likelihood_field)
        self._rng = np.random.default_rng(seed)
        self.particles: Array = np.zeros((0, 3))
        self._weights: Array = np.zeros(0)
        self._updates = 0

    @property
    def started(self) -> bool:
        """Whether a first pose was given."""
        return len(self.particles) > 0

    def start(self, pose: Array, covariance: Array) -> None:
        """Spread particles around a pose (3,). Raises ValueError for non-finite values or a negative variance."""
        if not (np.isfinite(pose).all() and np.isfinite(covariance).all()):
            raise ValueError("the initial pose is not finite")
        values, vectors = np.linalg.eigh((covariance + covariance.T) / 2.0)
        if values[0] < -1e-9:
            raise ValueError("the initial covariance has a negative variance")
        n = self.settings.max_particles
        noise = self._rng.normal(size=(n, 3)) * np.sqrt(np.maximum(values, 0.0))
        self.particles = pose + noise @ vectors.T
        self.particles[:, 2] = wrap(self.particles[:, 2])
        self._weights = np.full(n, 1.0 / n)

    def is_due(self, motion: Array) -> bool:
        """Whether the robot has moved enough (3,) in its frame for an update."""
        s = self.settings
        return math.hypot(motion[0], motion[1]) >= s.update_min_d or abs(motion[2]) >= s.update_min_a

    def predict(self, motion: Array) -> None:
        """Move every particle by odometry (3,), in the robot's frame, with the omni model's noise."""
        a1, a2, a3, a4, a5 = self.settings.alpha
        travel, turn = math.hypot(motion[0], motion[1]), float(motion[2])
        n = len(self.particles)
        along = travel + self._rng.normal(size=n) * math.sqrt(a3 * travel**2 + a1 * turn**2)
        across = self._rng.normal(size=n) * math.sqrt(a1 * turn**2 + a5 * travel**2)
        bearing = math.atan2(motion[1], motion[0]) + self.particles[:, 2]
        turns = turn + self._rng.normal(size=n) * math.sqrt(a4 * turn**2 + a2 * travel**2)
        c, s = np.cos(bearing), np.sin(bearing)
        self.particles[:, 0] += along * c + across * s
        self.particles[:, 1] += along * s - across * c
        self.particles[:, 2] = wrap(self.particles[:, 2] + turns)

    def correct(self, points: Array) -> Belief:
        """Weigh the particles by a scan (b, 2) in the robot's frame, resample, and return where the robot is."""
        s = self.settings
        thinned = np.ascontiguousarray(points[:: max(1, math.ceil(len(points) / s.max_beams))])
        self._weigh(thinned)
        belief = self.belief(points)
        if not belief.refined:
            belief = replace(belief, explained=self._explained(points, thinned))
        self._updates += 1
        if self._updates % s.resample_interval == 0:
            self._resample()
        return belief

    def _explained(self, points: Array, thinned: Array) -> float:
        """The share of the scan that the map explains at the likeliest particle: in a vague cloud, the mean may be nowhere."""
        likeliest = self.particles[int(self.field.log_likelihood(self.particles, thinned).argmax())]
        information = np.diag(1.0 / LIKELIEST_SIGMA**2) * self._together(points)
        return refine_on_field(self.field, points, likeliest, likeliest, information)[2]

    @staticmethod
    def _together(points: Array) -> float:
        """How many beams count as one independent measurement."""
        return BEAMS_PER_MEASUREMENT * max(1.0, len(points) / 180.0)

    def _weigh(self, thinned: Array) -> None:
        """Weigh the particles by the likelihood of a scan.

        If only a thinned particles would keep all the weight, as after a vague initial pose, their spread would not show the
        error. Then the likelihood is applied in parts (tempering, Neal 2001): each part leaves enough particles, which are
        resampled and jittered by a kernel (regularised particle filter, Musso et al. 2001) before the next.
        """
        left = 1.0
        for last in (False,) * MAX_PARTS + (True,):
            likelihood = self.field.log_likelihood(self.particles, thinned)
            part = left if last else self._max_exponent(likelihood, left)
            self._weights = _scaled(self._weights, likelihood, part)
            left -= part
            if left <= 1e-9:
                return
            self._draw(len(self.particles))
            self._jitter()

    def _max_exponent(self, likelihood: Array, limit: float) -> float:
        """The largest exponent up to `limit` of the likelihood that leaves enough effective particles."""
        min_effective = MIN_EFFECTIVE_SHARE * len(self.particles)
        if _effective_size(_scaled(self._weights, likelihood, limit)) >= min_effective:
            return limit
        low, high = 0.0, limit
        for _ in range(20):
            middle = (low + high) / 2.0
            enough = _effective_size(_scaled(self._weights, likelihood, middle)) >= min_effective
            low, high = (middle, high) if enough else (low, middle)
        return max(low, limit / (2.0 * MAX_PARTS))

    def _jitter(self) -> None:
        """Move each particle at random, by a kernel that fits the cloud's spread and size, at most KERNEL wide."""
        mean = self.particles.mean(axis=0)
        mean[2] = math.atan2(float(np.sin(self.particles[:, 2]).mean()), float(np.cos(self.particles[:, 2]).mean()))
        offset = self.particles - mean
        offset[:, 2] = wrap(offset[:, 2])
        width = (4.0 / (5.0 * len(self.particles))) ** (1.0 / 7.0) * offset.std(axis=0)  # Silverman's rule in 3 dimensions
        self.particles += self._rng.normal(size=self.particles.shape) * np.minimum(width, KERNEL)
        self.particles[:, 2] = wrap(self.particles[:, 2])

    def belief(self, points: Array | None = None) -> Belief:
        """The cloud's mean and covariance, refined on `points` (b, 2) if the cloud is small enough."""
        w = self._weights
        yaw = math.atan2(float(w @ np.sin(self.particles[:, 2])), float(w @ np.cos(self.particles[:, 2])))
        mean = np.array([float(w @ self.particles[:, 0]), float(w @ self.particles[:, 1]), yaw])
        offset = self.particles - mean
        offset[:, 2] = wrap(offset[:, 2])
        cloud = (offset * w[:, None]).T @ offset + FLOOR
        if points is None or math.sqrt(cloud[0, 0] + cloud[1, 1]) > 0.35 or math.sqrt(cloud[2, 2]) > 0.35:
            return Belief(mean, cloud, False)
        prior = np.linalg.inv(cloud)
        together = self._together(points)
        pose, information, near = refine_on_field(self.field, points, mean, mean, prior * together)
        shift = pose - mean
        shift[2] = float(wrap(np.asarray(shift[2])))
        if near < self.settings.min_near_share or float(shift @ prior @ shift) > 16.0:
            return Belief(mean, cloud, False)
        return Belief(pose, np.asarray(np.linalg.inv(information / together + prior)) + FLOOR, True, near)

    def _resample(self) -> None:
        """Resample, with low variance, to as many particles as the KLD bound requires."""
        s = self.settings
        n = self._kld_bound()
        self._draw(n)
        assert s.min_particles <= n <= s.max_particles

    def _draw(self, n: int) -> None:
        """Draw `n` particles by their weights, with low variance."""
        marks = (self._rng.random() + np.arange(n)) / n
        picked = np.searchsorted(np.cumsum(self._weights), marks).clip(max=len(self.particles) - 1)
        self.particles = np.ascontiguousarray(self.particles[picked])
        self._weights = np.full(n, 1.0 / n)

    def _kld_bound(self) -> int:
        """Fox's bound on the particles that keep the KL divergence below `pf_err`, for the bins the weight occupies."""
        s = self.settings
        marks = (self._rng.random() + np.arange(s.max_particles)) / s.max_particles
        likely = self.particles[np.searchsorted(np.cumsum(self._weights), marks).clip(max=len(self.particles) - 1)]
        bins = len(np.unique(np.floor(likely / _BIN).astype(np.int64), axis=0))
        if bins < 2:
            return s.min_particles
        b = 2.0 / (9.0 * (bins - 1))
        bound = (bins - 1) / (2.0 * s.pf_err) * (1.0 - b + math.sqrt(b) * s.pf_z) ** 3
        return int(min(max(math.ceil(bound), s.min_particles), s.max_particles))
