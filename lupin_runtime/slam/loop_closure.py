"""Loop closure: candidates by distance and drift, verified by a wide correlative search, confirmed by a second closure.

A wrong closure ruins a map and a missed one only leaves it bent, so each test can reject a closure: score, overlap, walls in
free space, another pose that fits as well, and, if the correction is large, the lack of a second closure that agrees.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.slam import kernels
from lupin_runtime.slam.keyframes import KeyframeGraph
from lupin_runtime.slam.local_map import FieldShape, LocalMap
from lupin_runtime.slam.scan import ScanPoints
from lupin_runtime.slam.scan_matching import Match, Window, refine, search
from lupin_runtime.slam.se2 import compose, relative_pose, rotate_information, wrap

Array = NDArray[np.floating]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class FarLimits:
    """Stricter limits for searches wider than `window_m`, in which a corridor's next door may look like this one.

    `conflict` limits the share of walls of either scan in space that the other saw through; `independent_m` is the minimum
    distance along the path between two closures that confirm each other, `rest_m` the distance to the next wide search after
    one that found nothing.
    """

    window_m: float = 1.0
    fit: float = 0.85
    overlap: float = 0.15
    conflict: float = 0.22
    independent_m: float = 1.5
    rest_m: float = 0.8


@dataclass(frozen=True)
class LoopSettings:
    """When closures are searched and accepted.

    The search window grows by `drift` with the path since the place was last seen. Corrections below `sure_m` and `sure_rad`
    are accepted at once, larger ones if a second closure agrees within `agree_m` and `agree_rad`. A rival pose whose score
    is at least the share `rival` of the best makes a match ambiguous.
    """

    distance_m: float = 3.0
    beyond_path_m: float = 8.0
    max_window: Window = field(default_factory=lambda: Window(8.0, 0.6))
    drift_m: tuple[float, float] = (0.05, 0.015)  # at once, per meter of path
    drift_rad: tuple[float, float] = (0.03, 0.003)
    chain: int = 10
    group: int = 24
    group_path_m: float = 8.0
    source_path_m: float = 4.0
    source: int = 8
    tries: int = 2
    coarse_score: float = 0.35
    fine_score: float = 0.45
    min_fit: float = 0.6
    max_conflict: float = 0.12
    far: FarLimits = field(default_factory=lambda: FarLimits())
    rival: float = 0.94
    rivals: int = 4
    sure_m: float = 0.3
    sure_rad: float = 0.06
    agree_m: float = 0.25
    agree_rad: float = 0.05
    max_pending: int = 12


@dataclass(frozen=True)
class Closure:
    """A recognized place: `measured` (3,) is the pose of keyframe `head` in the map around `tail`; `was` (3,) its old one."""

    tail: int
    head: int
    measured: Array
    was: Array
    information: Array
    score: float


class LoopCloser:
    """Finds closures of a growing graph; those that need confirmation by a second one are pending."""

    def __init__(self, settings: LoopSettings | None = None, shape: FieldShape | None = None) -> None:
        self.settings = settings or LoopSettings()
        self._local = LocalMap(shape)
        self._pending: list[Closure] = []
        self._missed: int | None = None  # the keyframe whose wide search last found nothing
        self.searches = 0

    def drop_pending(self) -> None:
        """Drop pending closures: after an optimization they refer to an outdated map."""
        self._pending.clear()

    def find_closures(self, graph: KeyframeGraph, number: int) -> list[Closure]:
        """Return the closures of keyframe `number` to accept now: none, one, or several that agree."""
        lengths = graph.path_lengths(number)
        far = self.settings.far
        # A wide search is expensive, and what it did not find start it will not find a few centimeters further.
        resting = self._missed is not None and bool(lengths[self._missed] < far.rest_m)
        for candidate in self._candidates(graph, number, lengths):
            wide = self._window(float(lengths[candidate])).half_m > far.window_m
            if wide and resting:
                continue
            closure = self.verify(graph, number, candidate, lengths)
            if closure is not None:
                self._missed = None
                return self._confirm(graph, closure, lengths)
            if wide:
                self._missed = number
        return []

    def _window(self, path_m: float) -> Window:
        """Three standard deviations of the drift over a path."""
        s = self.settings
        path_m = min(path_m, 1e4)
        return Window(
            min(3.0 * (s.drift_m[0] + s.drift_m[1] * path_m), s.max_window.half_m),
            min(3.0 * (s.drift_rad[0] + s.drift_rad[1] * path_m), s.max_window.half_rad),
        )

    def _candidates(self, graph: KeyframeGraph, number: int, lengths: Array) -> list[int]:
        """The nearest keyframes within the possible drift, at most `tries`, at least 3 m apart from each other."""
        s = self.settings
        poses = graph.poses
        away = np.hypot(*(poses[:, :2] - poses[number, :2]).T)
        reach = np.minimum(s.distance_m + 3.0 * s.drift_m[1] * np.minimum(lengths, 1e4), s.distance_m + s.max_window.half_m)
        open_ = np.flatnonzero((lengths > s.beyond_path_m) & (away < reach))
        chosen: list[int] = []
        for candidate in open_[np.argsort(away[open_], kind="stable")]:
            if all(np.hypot(*(poses[candidate, :2] - poses[other, :2])) > 3.0 for other in chosen):
                chosen.append(int(candidate))
                if len(chosen) == s.tries:
                    break
        return chosen

    def verify(self, graph: KeyframeGraph, number: int, candidate: int, lengths: Array) -> Closure | None:
        """Match the surroundings of keyframe `number` to those of `candidate`; None unless every test is passed."""
        s = self.settings
        self.searches += 1
        poses = graph.poses
        start = poses[number].copy()
        window = self._window(float(lengths[candidate]))
        # The local map must cover the whole window, else the true pose may lose to a wrong one that is covered.
        wider = window.half_m if window.half_m > s.far.window_m else 0.0
        limit = round(s.group * (1.0 + wider / s.group_path_m))
        group = self._neighborhood(graph, candidate, s.group_path_m + wider, limit, lengths > s.beyond_path_m)
        if len(group) < s.chain:
            return None
        center = (float(poses[candidate, 0]), float(poses[candidate, 1]))
        self._local.build(graph.pool, group, poses[group], center)
        source = self._merged_scan(graph, number, lengths)
        fit = self._unambiguous_match(graph, group, center, number, lengths, source, start, window)
        if fit is None:
            return None
        tail = int(group[np.argmin(np.hypot(*(poses[group, :2] - fit.pose[:2]).T))])
        return Closure(tail, number, fit.pose, start, self._information(fit), fit.score)

    def _unambiguous_match(
        self, graph: KeyframeGraph, group: Index, center: tuple[float, float], number: int, lengths: Array, source: ScanPoints,
        start: Array, window: Window,
    ) -> Match | None:  # fmt: skip
        """The only pose of the window that passes every test; None if there is none, or more than one."""
        s = self.settings
        far = window.half_m > s.far.window_m
        points = source.thinned(0.1)
        spread = np.diag([(window.half_m / 3) ** 2, (window.half_m / 3) ** 2, (window.half_rad / 3) ** 2])
        tried: list[Array] = []
        passed: Match | None = None
        min_score = s.coarse_score
        for _ in range(s.rivals if far else 1):
            found = search(self._local, points, start, spread, window, min_score, 0.002, tried)
            if found is None:
                return passed
            tried.append(found[1])
            min_score = max(min_score, s.rival * found[0])
            fit = refine(self._local, source, found[1], found[1], np.eye(3) * 4.0, points)
            if not self._passes_tests(graph, group, center, number, lengths, source, fit, far):
                continue
            if passed is not None:
                return None
            passed = fit
        return None if far else passed

    def _passes_tests(
        self, graph: KeyframeGraph, group: Index, center: tuple[float, float], number: int, lengths: Array, source: ScanPoints,
        fit: Match, far: bool,
    ) -> bool:  # fmt: skip
        s = self.settings
        if fit.score < s.fine_score or fit.fit < (s.far.fit if far else s.min_fit):
            return False
        if far and fit.overlap < s.far.overlap:
            return False
        conflict = self._conflict(graph, group, graph.poses[group], center, source.thinned(0.1), fit.pose)
        if conflict > s.max_conflict or not far:
            return conflict <= s.max_conflict
        around = self._source_keyframes(lengths)
        moved = np.stack([compose(fit.pose, relative_pose(graph.poses[number], graph.poses[other])) for other in around])
        walls = self._local.marked_points()
        back = self._conflict(graph, around, moved, (float(fit.pose[0]), float(fit.pose[1])), walls, np.zeros(3))
        return conflict + back <= s.far.conflict

    @staticmethod
    def _information(fit: Match) -> Array:
        # Both neighborhoods are slightly bent: a closure is never as exact as a match of neighboring scans.
        return np.asarray(np.linalg.inv(fit.covariance + np.diag([0.01**2, 0.01**2, 0.004**2])))

    def _neighborhood(self, graph: KeyframeGraph, number: int, path_m: float, limit: int, allowed: NDArray[np.bool_]) -> Index:
        near = np.flatnonzero((graph.path_lengths(number, path_m) <= path_m) & allowed)
        away = np.hypot(*(graph.poses[near, :2] - graph.poses[number, :2]).T)
        return near[np.argsort(away, kind="stable")[:limit]]

    def _source_keyframes(self, lengths: Array) -> Index:
        near = np.flatnonzero(lengths <= self.settings.source_path_m)
        return near[np.argsort(lengths[near], kind="stable")[: self.settings.source]]

    def _merged_scan(self, graph: KeyframeGraph, number: int, lengths: Array) -> ScanPoints:
        """Merge the scans around a keyframe into one, in its frame."""
        near = self._source_keyframes(lengths)
        xy, normal, sigma = [], [], []
        for other in near:
            scan = graph.pool.scan(int(other))
            offset = relative_pose(graph.poses[number], graph.poses[other])
            c, sn = math.cos(offset[2]), math.sin(offset[2])
            rotation = np.array([[c, sn], [-sn, c]])
            xy.append(scan.xy @ rotation + offset[:2])
            normal.append(scan.normal @ rotation)
            sigma.append(scan.sigma)
        return ScanPoints(np.concatenate(xy), np.concatenate(normal), np.concatenate(sigma), graph.pool.sensor[number])

    def _conflict(
        self, graph: KeyframeGraph, numbers: Index, poses: Array, center: tuple[float, float], points: Array, pose: Array
    ) -> float:
        """Return the share of `points` at `pose` in space that the keyframes `numbers` at `poses` saw through."""
        cell, reach = 0.1, self._local.shape.reach_m
        size = 2 * math.ceil(reach / cell)
        seen, hit = np.zeros((size, size), np.int32), np.zeros((size, size), np.int32)
        first = (math.floor((center[0] - reach) / cell), math.floor((center[1] - reach) / cell))
        corner = (first[0] * cell, first[1] * cell)
        for number, at in zip(numbers, poses):
            scan = graph.pool.scan(int(number))
            kernels.count_beams(seen, hit, first, cell, scan.xy, at.copy(), scan.sensor, 1)
        conflicts, known = kernels.count_conflicts(seen, hit, corner, cell, points, pose, 2)
        return conflicts / known if known >= 30 else 1.0

    def _confirm(self, graph: KeyframeGraph, closure: Closure, lengths: Array) -> list[Closure]:
        """Return the closures to accept: this one if its correction is small, or together with those that agree."""
        s = self.settings
        shift = relative_pose(closure.was, closure.measured)
        if math.hypot(shift[0], shift[1]) < s.sure_m and abs(shift[2]) < s.sure_rad:
            return [closure]
        agreeing = [other for other in self._pending if self._agree(graph, closure, other, lengths)]
        if agreeing:
            self._pending = [other for other in self._pending if all(other is not agreed for agreed in agreeing)]
            return [*agreeing, closure]
        if all(other.head != closure.head for other in self._pending):
            self._pending = [*self._pending, closure][-s.max_pending :]
        return []

    def _agree(self, graph: KeyframeGraph, new: Closure, old: Closure, lengths: Array) -> bool:
        """Whether two closures agree: the loop through both returns to its start (Mangelson et al., ICRA 2018)."""
        s = self.settings
        path = float(lengths[old.head])
        if old.head == new.head or not s.far.independent_m <= path < 25.0:
            return False
        between = relative_pose(graph.poses[old.head], graph.poses[new.head])
        expected = compose(old.measured, between)
        gap = relative_pose(expected, new.measured)
        return bool(
            math.hypot(gap[0], gap[1]) < s.agree_m + 0.01 * path and abs(float(wrap(gap[2]))) < s.agree_rad + 0.001 * path
        )


def information_at_head(closure: Closure) -> Array:
    """Return the closure's information (3, 3) in the axes of its head, as an edge needs it."""
    return rotate_information(closure.information, float(closure.measured[2]))
