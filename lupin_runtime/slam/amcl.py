"""Adaptive Monte Carlo localisation on a saved map: particles say where the robot may be, a refinement says where exactly.

Motion and sensor models are Nav2's omni model and likelihood field (Thrun, Burgard, Fox 2005, 5.4, 6.4, 8.3); the number of
particles follows Fox's KLD bound (2003). The published covariance is meant to be believed: particles alone are too few to
measure centimetres, so the refined pose carries the information of its scan, and the cloud's spread where that says little.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.gridmap import GridMap
from lupin_runtime.slam.likelihood_field import BeamModel, LikelihoodField, refine_on_field

Array = NDArray[np.floating]

# Beams on one wall share its flaws, and a grid has cells: the refinement's information counts as that of one beam in this many.
BEAMS_THAT_ERR_TOGETHER = 4.0
# A grid of 5 cm cells is never better known than this (m, m, rad).
FLOOR = np.diag([0.012**2, 0.012**2, 0.004**2])
# The share of the particles that a scan may not go below, in effective number; parts of a scan at most; a kernel's widest.
LEAST_EFFECTIVE, MAX_PARTS = 0.05, 12
KERNEL = np.array([0.15, 0.15, 0.1])
# Bins of the KLD bound: Nav2's, m and rad.
_BIN = np.array([0.5, 0.5, math.radians(10.0)])


@dataclass(frozen=True)
class AmclSettings:
    """Nav2's parameters of the same names; `least_near` is the share of beams that must fit before a refinement is believed."""

    alpha: tuple[float, float, float, float, float] = (0.2, 0.2, 0.2, 0.2, 0.2)
    min_particles: int = 500
    max_particles: int = 2000
    max_beams: int = 60
    update_min_d: float = 0.25
    update_min_a: float = 0.2
    resample_interval: int = 1
    pf_err: float = 0.05
    pf_z: float = 2.33  # the upper quantile at 0.99
    beams: BeamModel = field(default_factory=BeamModel)
    least_near: float = 0.55


@dataclass(frozen=True)
class Belief:
    """Where the robot is: pose (3,) and covariance (3, 3) in the map; `refined` where a scan pinned it down."""

    pose: Array
    covariance: Array
    refined: bool


def wrap(angle: Array) -> Array:
    """The same directions within [-pi, pi)."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def _scaled(weights: Array, log_likelihood: Array, exponent: float) -> Array:
    """Weights (n,) times a power of the likelihood, normalised."""
    score = np.log(np.maximum(weights, 1e-300)) + exponent * log_likelihood
    scaled = np.exp(score - score.max())
    return np.asarray(scaled / scaled.sum())


def _effective(weights: Array) -> float:
    """The number of equally weighted particles that would say as much."""
    return 1.0 / float(weights @ weights)


class Amcl:
    """A particle filter over poses in a map."""

    def __init__(self, grid: GridMap, settings: AmclSettings | None = None, seed: int = 0) -> None:
        self.settings = settings or AmclSettings()
        self.field = LikelihoodField(grid, self.settings.beams)
        self._rng = np.random.default_rng(seed)
        self.particles: Array = np.zeros((0, 3))
        self._weights: Array = np.zeros(0)
        self._updates = 0

    @property
    def started(self) -> bool:
        """Whether a first pose was given."""
        return len(self.particles) > 0

    def start(self, pose: Array, covariance: Array) -> None:
        """Spread particles around a pose (3,). Raises ValueError unless both are finite and the covariance is one."""
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
        turned = turn + self._rng.normal(size=n) * math.sqrt(a4 * turn**2 + a2 * travel**2)
        c, s = np.cos(bearing), np.sin(bearing)
        self.particles[:, 0] += along * c + across * s
        self.particles[:, 1] += along * s - across * c
        self.particles[:, 2] = wrap(self.particles[:, 2] + turned)

    def correct(self, points: Array) -> Belief:
        """Weigh the particles by a scan (b, 2) in the robot's frame, resample, and say where the robot is."""
        s = self.settings
        few = np.ascontiguousarray(points[:: max(1, math.ceil(len(points) / s.max_beams))])
        self._weigh(few)
        belief = self.belief(points)
        self._updates += 1
        if self._updates % s.resample_interval == 0:
            self._resample()
        return belief

    def _weigh(self, few: Array) -> None:
        """Weights by the likelihood of a scan.

        Where only a handful of particles would keep all the weight, as after a vague first pose, their spread says nothing of
        the error. Then the likelihood is taken in parts (tempering, Neal 2001): each part leaves enough particles, which are
        drawn anew and spread by a kernel (regularised particle filter, Musso et al. 2001) before the next.
        """
        left = 1.0
        for last in (False,) * MAX_PARTS + (True,):
            likelihood = self.field.log_likelihood(self.particles, few)
            part = left if last else self._bearable(likelihood, left)
            self._weights = _scaled(self._weights, likelihood, part)
            left -= part
            if left <= 1e-9:
                return
            self._draw(len(self.particles))
            self._spread()

    def _bearable(self, likelihood: Array, most: float) -> float:
        """The largest exponent up to `most` by which the likelihood leaves enough particles effective."""
        least = LEAST_EFFECTIVE * len(self.particles)
        if _effective(_scaled(self._weights, likelihood, most)) >= least:
            return most
        low, high = 0.0, most
        for _ in range(20):
            middle = (low + high) / 2.0
            enough = _effective(_scaled(self._weights, likelihood, middle)) >= least
            low, high = (middle, high) if enough else (low, middle)
        return max(low, most / (2.0 * MAX_PARTS))

    def _spread(self) -> None:
        """Move each particle a little, by what the cloud's spread makes of their number; no further than KERNEL."""
        mean = self.particles.mean(axis=0)
        mean[2] = math.atan2(float(np.sin(self.particles[:, 2]).mean()), float(np.cos(self.particles[:, 2]).mean()))
        offset = self.particles - mean
        offset[:, 2] = wrap(offset[:, 2])
        width = (4.0 / (5.0 * len(self.particles))) ** (1.0 / 7.0) * offset.std(axis=0)  # Silverman's rule in 3 dimensions
        self.particles += self._rng.normal(size=self.particles.shape) * np.minimum(width, KERNEL)
        self.particles[:, 2] = wrap(self.particles[:, 2])

    def belief(self, points: Array | None = None) -> Belief:
        """The cloud's mean and covariance, refined on `points` where they pin it down."""
        w = self._weights
        yaw = math.atan2(float(w @ np.sin(self.particles[:, 2])), float(w @ np.cos(self.particles[:, 2])))
        mean = np.array([float(w @ self.particles[:, 0]), float(w @ self.particles[:, 1]), yaw])
        offset = self.particles - mean
        offset[:, 2] = wrap(offset[:, 2])
        cloud = (offset * w[:, None]).T @ offset + FLOOR
        if points is None or math.sqrt(cloud[0, 0] + cloud[1, 1]) > 0.35 or math.sqrt(cloud[2, 2]) > 0.35:
            return Belief(mean, cloud, False)
        prior = np.linalg.inv(cloud)
        pose, information, near = refine_on_field(
            self.field, points, mean, mean, prior * BEAMS_THAT_ERR_TOGETHER * max(1.0, len(points) / 180.0)
        )
        shift = pose - mean
        shift[2] = float(wrap(np.asarray(shift[2])))
        if near < self.settings.least_near or float(shift @ prior @ shift) > 16.0:
            return Belief(mean, cloud, False)
        together = BEAMS_THAT_ERR_TOGETHER * max(1.0, len(points) / 180.0)
        return Belief(pose, np.asarray(np.linalg.inv(information / together + prior)) + FLOOR, True)

    def _resample(self) -> None:
        """Low-variance resampling to as many particles as the KLD bound asks for."""
        s = self.settings
        n = self._bound()
        self._draw(n)
        assert s.min_particles <= n <= s.max_particles

    def _draw(self, n: int) -> None:
        """Draw `n` particles by their weights, with low variance."""
        marks = (self._rng.random() + np.arange(n)) / n
        picked = np.searchsorted(np.cumsum(self._weights), marks).clip(max=len(self.particles) - 1)
        self.particles = np.ascontiguousarray(self.particles[picked])
        self._weights = np.full(n, 1.0 / n)

    def _bound(self) -> int:
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
