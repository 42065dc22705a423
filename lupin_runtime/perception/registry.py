"""The tags seen so far: each tag's pose in the map, fused robustly from its sightings.

Sightings have different errors. Corner noise grows with distance and averages out over frames; the robot's own pose error is
shared by all frames from one place and averages out only over places; a mirrored pose or a frame taken in a fast turn is an
outlier. So all frames of a place share one error, distance determines the rest, and Huber weights suppress outliers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2
from lupin_runtime.perception.map_jumps import MapJump
from lupin_runtime.transforms import Quaternion, Transform, Vector, multiply, rotate

Array = NDArray[np.float64]

# Standard deviations. One place's share of the robot's error; range error per meter squared; bearing error per meter.
PLACE_SIGMA_M = 0.02
RANGE_SIGMA_PER_M2 = 0.002
BEARING_SIGMA_PER_M = 0.01
# The remaining error after a map jump has corrected a sighting, as a share of how far the sighting moved.
LEFT_AFTER_JUMP = 0.3
MAX_DOUBT_M = 0.1
PLACE_CELL_M = 0.25
HUBER_SIGMAS = 1.5
ITERATIONS = 12
CAPACITY = 160
# A plate's normal is known to a degree or so from close up; seen from further, or nearly head-on, less well.
NORMAL_SIGMA_RAD = math.radians(1.0)


@dataclass(frozen=True)
class Sighting:
    """One sighting: `pose` is map_from_tag, `camera` the camera's position in the map; `traveled` the path length, m."""

    stamp_ns: int
    pose: Transform
    camera: Vector
    traveled: float = 0.0
    spread_m: float = 0.0  # added uncertainty: while the map is unsettled, and after it has moved

    @cached_property
    def range_m(self) -> float:
        """Distance from camera to tag."""
        return math.dist(self.pose.translation, self.camera)

    @cached_property
    def place(self) -> tuple[int, int]:
        """The cell of the map from which the tag was seen."""
        return math.floor(self.camera[0] / PLACE_CELL_M), math.floor(self.camera[1] / PLACE_CELL_M)

    @cached_property
    def normal(self) -> Vector:
        """The plate's outward normal in the map."""
        return rotate(self.pose.rotation, (0.0, 0.0, 1.0))

    @cached_property
    def variance(self) -> float:
        """Variance of the position, m², if it were the only sighting from its place."""
        corners = (RANGE_SIGMA_PER_M2 * self.range_m**2) ** 2 + (BEARING_SIGMA_PER_M * self.range_m) ** 2
        return self.place_variance + corners

    @cached_property
    def place_variance(self) -> float:
        """The part of the variance, m², that all frames from this place share."""
        return PLACE_SIGMA_M**2 + self.spread_m**2

    @cached_property
    def normal_sigma(self) -> float:
        """Standard deviation of the normal, rad: worse with distance, and head-on, where a turn changes the image least."""
        view = [c - t for c, t in zip(self.camera, self.pose.translation)]
        cosine = sum(v * n for v, n in zip(view, self.normal)) / max(self.range_m, 1e-6)
        sine = math.sqrt(max(0.0, 1.0 - min(1.0, cosine**2)))
        return NORMAL_SIGMA_RAD * (1.0 + self.range_m**2) / max(0.25, sine) + self.spread_m / 2.0

    @property
    def order(self) -> tuple[int, Vector]:
        """A total order that doesn't depend on arrival."""
        return self.stamp_ns, self.pose.translation

    def moved(self, motion: Pose2, doubt_m: float = 0.0) -> Sighting:
        """The same sighting on a map that moved by `motion`, new_map_from_old_map; its spread grows with the distance.

        `doubt_m` is how much further it may have moved.
        """
        half = motion.yaw / 2.0
        turn = Transform((motion.x, motion.y, 0.0), (0.0, 0.0, math.sin(half), math.cos(half)))
        pose = turn @ self.pose
        shift = math.dist(pose.translation, self.pose.translation)
        return replace(
            self,
            pose=pose,
            camera=turn.apply(self.camera),
            # Doubts do not add up: a robot that slips for a minute makes old sightings no worse than one that slips once.
            spread_m=max(math.hypot(self.spread_m, LEFT_AFTER_JUMP * shift), min(doubt_m, MAX_DOUBT_M)),
        )


@dataclass(frozen=True)
class KnownTag:
    """A tag with its fused pose, map_from_tag, the number of its sightings, and the standard error of its position, m."""

    id: str
    pose: Transform
    sightings: int
    last_seen_ns: int
    spread_m: float


class TagRegistry:
    """Sightings by tag. The fused pose depends on which sightings are kept, not on their order of arrival."""

    def __init__(self, min_sightings: int = 3) -> None:
        self.min_sightings = max(1, min_sightings)
        self._sightings: dict[str, list[Sighting]] = {}
        self._count: dict[str, int] = {}
        self._last_seen_ns: dict[str, int] = {}
        self._fused: dict[str, tuple[Transform, float]] = {}

    def add(self, tag_id: str, sighting: Sighting) -> bool:
        """Add a sighting; returns False and ignores it if it is not finite."""
        numbers = (*sighting.pose.translation, *sighting.pose.rotation, *sighting.camera)
        if not all(map(math.isfinite, numbers)):
            return False
        kept = self._sightings.setdefault(tag_id, [])
        kept.append(sighting)
        if len(kept) > CAPACITY:
            kept.remove(_least_useful(kept))
        self._count[tag_id] = self._count.get(tag_id, 0) + 1
        self._last_seen_ns[tag_id] = max(sighting.stamp_ns, self._last_seen_ns.get(tag_id, 0))
        self._fused.pop(tag_id, None)
        return True

    def follow(self, jump: MapJump) -> None:
        """Move every sighting with the part of the path from which it was made."""
        for tag_id, kept in self._sightings.items():
            self._sightings[tag_id] = [s.moved(jump.motion_at(s.traveled), jump.doubt_m) for s in kept]
        self._fused.clear()

    def forget_times(self) -> None:
        """Forget when tags were last seen, after the clock went back."""
        self._last_seen_ns = dict.fromkeys(self._last_seen_ns, 0)
        self._fused.clear()

    def sightings(self, tag_id: str) -> int:
        """The number of sightings of a tag."""
        return self._count.get(tag_id, 0)

    def get(self, tag_id: str) -> KnownTag | None:
        """Return a tag with at least one sighting, or None."""
        kept = self._sightings.get(tag_id)
        if not kept:
            return None
        if tag_id not in self._fused:
            self._fused[tag_id] = fuse(kept)
        pose, spread_m = self._fused[tag_id]
        return KnownTag(tag_id, pose, self._count[tag_id], self._last_seen_ns[tag_id], spread_m)

    def discovered(self) -> list[KnownTag]:
        """Tags seen often enough, in the order of their first sighting."""
        known = (self.get(tag_id) for tag_id, count in self._count.items() if count >= self.min_sightings)
        return [tag for tag in known if tag is not None]

    def doubt(self, tag_id: str, now_ns: int, freshness_s: float) -> str | None:
        """Why a tag cannot be confirmed as present now; None if it can."""
        seen = self.sightings(tag_id)
        if seen == 0:
            known = ", ".join(tag.id for tag in self.discovered()) or "none"
            return f"tag {tag_id!r} not discovered; discovered so far: {known}"
        if seen < self.min_sightings:
            return f"tag {tag_id} below threshold: {seen} of {self.min_sightings} sightings"
        age_s = (now_ns - self._last_seen_ns[tag_id]) / 1e9
        if age_s > freshness_s:
            return f"tag {tag_id} is stale: last seen {age_s:.1f} s ago, the limit is {freshness_s:g} s"
        return None

    def __len__(self) -> int:
        return len(self._sightings)


def fuse(sightings: list[Sighting]) -> tuple[Transform, float]:
    """Fuse sightings: the pose, and the standard error of its position in meters."""
    ordered = sorted(sightings, key=lambda s: s.order)
    crowd: dict[tuple[int, int], int] = {}
    for s in ordered:
        crowd[s.place] = crowd.get(s.place, 0) + 1
    # All frames of one place together have the weight that the place's shared error allows, however many they are.
    shared = np.array([(crowd[s.place] - 1) * s.place_variance for s in ordered])
    single = np.array([s.variance for s in ordered])
    position = _robust_mean(np.array([s.pose.translation for s in ordered]), 1.0 / (single + shared), np.sqrt(single))
    normal = _robust_direction(np.array([s.normal for s in ordered]), np.array([s.normal_sigma for s in ordered]))
    # The best single sighting gives the rotation about the normal; it is turned onto the fused normal.
    best = ordered[int(np.argmin(single))]
    x, y, z = (float(value) for value in position)
    spread_m = float(np.sqrt(1.0 / np.sum(1.0 / (single + shared))))
    return Transform((x, y, z), _turned(best.pose.rotation, normal)), spread_m


def _robust_mean(points: Array, weights: Array, sigmas: Array) -> Array:
    """Huber's estimate of location, from the weighted median of each coordinate (Huber 1964, by reweighting)."""
    mean = np.array([_weighted_median(points[:, axis], weights) for axis in range(3)])
    for _ in range(ITERATIONS):
        distance = np.linalg.norm(points - mean, axis=1)
        weight = weights * np.minimum(1.0, HUBER_SIGMAS * sigmas / np.maximum(distance, 1e-9))
        step = weight @ points / weight.sum() - mean
        mean = mean + step
        if float(np.abs(step).max()) < 1e-6:
            break
    return np.asarray(mean)


def _robust_direction(directions: Array, sigmas: Array) -> Array:
    """The unit vector near most of the directions: the weighted medoid, then a mean with Huber weights about it.

    The normal of a mirrored pose changes with the viewpoint and a true one does not, so the largest cluster is right.
    """
    weight = 1.0 / sigmas**2
    candidates = directions[np.argsort(sigmas, kind="stable")[:32]]
    angles = np.arccos(np.clip(candidates @ directions.T, -1.0, 1.0))
    mean = candidates[int(np.argmin(np.minimum(angles, 0.5) @ weight))]
    for _ in range(ITERATIONS):
        angle = np.arccos(np.clip(directions @ mean, -1.0, 1.0))
        scaled = weight * np.minimum(1.0, HUBER_SIGMAS * sigmas / np.maximum(angle, 1e-9))
        total = scaled @ directions
        new = total / np.linalg.norm(total)
        step, mean = float(np.abs(new - mean).max()), new
        if step < 1e-7:
            break
    return np.asarray(mean)


def _turned(rotation: Quaternion, normal: Array) -> Quaternion:
    """Turn `rotation` by the smallest angle that brings its z axis onto `normal`."""
    now = np.array(rotate(rotation, (0.0, 0.0, 1.0)))
    axis = np.cross(now, normal)
    cosine = float(now @ normal)
    if cosine < -1.0 + 1e-9:
        return rotation
    q = np.array([*axis, 1.0 + cosine])
    x, y, z, w = (float(value) for value in q / np.linalg.norm(q))
    return multiply((x, y, z, w), rotation)


def _weighted_median(values: Array, weights: Array) -> float:
    order = np.argsort(values, kind="stable")
    cumulative = np.cumsum(weights[order])
    return float(values[order][int(np.searchsorted(cumulative, cumulative[-1] / 2.0))])


def _least_useful(sightings: list[Sighting]) -> Sighting:
    """Select the sighting to drop: of the place with the most, the most uncertain, then the furthest, then the oldest."""
    places: dict[tuple[int, int], int] = {}
    for s in sightings:
        places[s.place] = places.get(s.place, 0) + 1
    crowd = max(places.values())
    crowded = min(place for place, count in places.items() if count == crowd)
    members = [s for s in sightings if s.place == crowded]
    return max(members, key=lambda s: (s.spread_m, s.range_m, (-s.stamp_ns, s.pose.translation)))
