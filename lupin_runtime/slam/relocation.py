"""Relocation: where on a saved map a lost robot is, by one scan.

Poses over free space are scored by the likelihood field, the best ones are refined, and the best of these is accepted only if
the map explains its scan and no other place explains it about as well: two equal rows of tables are no answer. Where the robot
can be by its odometry is searched first. The rest of the map is searched only if the map has no open border, because beyond
one the greenhouse may look the same again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, label

from lupin_runtime.gridmap import FREE, UNKNOWN, GridMap
from lupin_runtime.slam.likelihood_field import OCCUPIED_FROM, LikelihoodField, refine_on_field
from lupin_runtime.slam.se2 import wrap

Array = NDArray[np.floating]

MIN_EXPLAINED = 0.7  # share of the scan's end points that the map must explain at the pose
MIN_LEAD = 0.1  # by how much the next best place must explain less
MAX_BLOCKED = 0.15  # share of the beams that would pass through an obstacle of the map
# Places nearer than this are one. A scan that fits one wall also fits along it.
SAME_PLACE_M, SAME_PLACE_RAD = 0.5, 0.35

# The coarse search: one pose per cell of this lattice and heading, on larger maps of a wider one.
_STEP_M, _STEP_RAD = 0.2, math.radians(6.0)
_MAX_POSES = 600_000
_MAX_BEAMS = 60
_ROBOT_RADIUS_M = 0.2
_SCORED, _REFINED = 5_000, 40  # how many of the best poses are compared, and how many places are refined
_BEAM_END_M = 0.25  # an obstacle this near to a beam's end is the one that it hit
_CHUNK = 50_000


@dataclass(frozen=True)
class Relocation:
    """The best pose (3,) with the share of the scan that it explains; `refusal` says why it is not to be used, or is ""."""

    pose: Array
    explained: float
    refusal: str = ""


@dataclass(frozen=True)
class Expected:
    """Where odometry says that the robot is: within `radius_m` and `turn_rad` of a pose (3,)."""

    pose: Array
    radius_m: float
    turn_rad: float

    @classmethod
    def after(cls, pose: Array, driven_m: float, turned_rad: float) -> Expected:
        """Return what is known at `pose` by odometry, this far after the last scan that the map explained."""
        return cls(pose, 0.5 + 0.2 * driven_m, min(math.pi, 0.35 + 0.1 * turned_rad + 0.05 * driven_m))

    def contains(self, poses: Array) -> NDArray[np.bool_]:
        """Return which of the poses (n, 3) are possible (n,)."""
        offset = poses - self.pose
        return np.asarray(
            (np.hypot(offset[:, 0], offset[:, 1]) <= self.radius_m) & (np.abs(wrap(offset[:, 2])) <= self.turn_rad)
        )


def relocate(field: LikelihoodField, points: Array, expected: Expected | None) -> Relocation:
    """Find the pose (x, y, yaw) in the map at which `points` (b, 2), in the robot's frame, were measured."""
    if expected is not None:
        found = _best(field, points, expected)
        if not found.refusal:
            return found
    if has_open_border(field.grid):
        return Relocation(np.zeros(3), 0.0, "the map has an open border, beyond which the robot may be")
    return _best(field, points, None)


def has_open_border(grid: GridMap) -> bool:
    """Return whether the robot could drive from the map's free space into the unknown."""
    free = (grid.cells >= FREE) & (grid.cells < OCCUPIED_FROM)
    unknown = np.pad(grid.cells == UNKNOWN, 1, constant_values=True)
    border = free & binary_dilation(unknown)[1:-1, 1:-1]
    parts, count = label(border, np.ones((3, 3)))
    sizes = np.bincount(parts.ravel(), minlength=count + 1)[1:]
    return bool((sizes * grid.resolution_m >= 2.0 * _ROBOT_RADIUS_M).any())


def _best(field: LikelihoodField, points: Array, expected: Expected | None) -> Relocation:
    candidates = _candidates(field, points, expected)
    if not len(candidates):
        return Relocation(np.zeros(3), 0.0, "the robot fits into no free space of the map")
    none = np.zeros((3, 3))
    found = [refine_on_field(field, points, pose, pose, none) for pose in candidates]
    poses, shares = np.array([pose for pose, _, _ in found]), np.array([share for _, _, share in found])
    possible = np.array([is_possible(field, points, pose) for pose in poses])
    if expected is not None:
        possible &= expected.contains(poses)
    if not possible.any():
        return Relocation(poses[0], 0.0, "no place explains the scan")
    shares[~possible] = 0.0
    best = int(shares.argmax())
    pose, explained = poses[best], float(shares[best])
    if explained < MIN_EXPLAINED:
        return Relocation(pose, explained, f"no place explains more than {explained:.0%} of the scan")
    offset = poses - pose
    apart_m = np.hypot(offset[:, 0], offset[:, 1])
    rivals = (shares >= explained - MIN_LEAD) & ((apart_m > SAME_PLACE_M) | (np.abs(wrap(offset[:, 2])) > SAME_PLACE_RAD))
    if rivals.any():
        rival_m = apart_m[rivals].min()
        return Relocation(pose, explained, f"two places {rival_m:.1f} m apart explain the scan about equally well")
    return Relocation(pose, explained)


def is_possible(field: LikelihoodField, points: Array, pose: Array) -> bool:
    """Return whether few of the beams to `points` would pass through an obstacle of the map at `pose`."""
    grid = field.grid
    length = np.hypot(points[:, 0], points[:, 1])
    bearing = np.arctan2(points[:, 1], points[:, 0]) + pose[2]
    along = np.arange(0.0, float(length.max(initial=0.0)), grid.resolution_m)
    x = pose[0] + np.cos(bearing)[:, None] * along
    y = pose[1] + np.sin(bearing)[:, None] * along
    column = np.floor((x - grid.origin_x) / grid.resolution_m).astype(int)
    row = np.floor((y - grid.origin_y) / grid.resolution_m).astype(int)
    inside = (column >= 0) & (row >= 0) & (column < grid.width) & (row < grid.height)
    inside &= along < length[:, None] - _BEAM_END_M
    cells = grid.cells[np.where(inside, row, 0), np.where(inside, column, 0)]
    return bool((inside & (cells >= OCCUPIED_FROM)).any(axis=1).mean() <= MAX_BLOCKED)


def _candidates(field: LikelihoodField, points: Array, expected: Expected | None) -> Array:
    """Return the best-scored poses (n, 3) of the coarse search, at most _REFINED and no two of them one place."""
    thinned = np.ascontiguousarray(points[:: max(1, math.ceil(len(points) / _MAX_BEAMS))])
    lattice = _free_places(field)
    headings = np.arange(0.0, 2.0 * math.pi, _STEP_RAD)
    poses = np.ascontiguousarray(
        np.concatenate((np.repeat(lattice, len(headings), axis=0), np.tile(headings, len(lattice))[:, None]), axis=1)
    )
    if expected is not None:
        poses = poses[expected.contains(poses)]
    scores = np.concatenate(
        [np.empty(0), *(field.log_likelihood(poses[at : at + _CHUNK], thinned) for at in range(0, len(poses), _CHUNK))]
    )
    best = poses[np.argsort(-scores, kind="stable")[:_SCORED]]
    kept: list[Array] = []
    while len(best) and len(kept) < _REFINED:
        kept.append(best[0])
        offset = best - best[0]
        apart = np.hypot(offset[:, 0], offset[:, 1]) > 2.0 * _STEP_M
        best = best[apart | (np.abs(wrap(offset[:, 2])) > 2.0 * _STEP_RAD)]
    return np.array(kept).reshape(-1, 3)


def _free_places(field: LikelihoodField) -> Array:
    """Return points (n, 2) of a lattice over the map's free space, at least the robot's radius from every obstacle."""
    grid = field.grid
    free = (grid.cells >= FREE) & (grid.cells < OCCUPIED_FROM) & (field.distance_m > _ROBOT_RADIUS_M)
    headings = 2.0 * math.pi / _STEP_RAD
    step = max(1, round(_STEP_M / grid.resolution_m))
    while free[::step, ::step].sum() * headings > _MAX_POSES:
        step += 1
    rows, columns = np.nonzero(free[::step, ::step])
    x = grid.origin_x + (columns * step + 0.5) * grid.resolution_m
    y = grid.origin_y + (rows * step + 0.5) * grid.resolution_m
    return np.stack((x, y), axis=1)
