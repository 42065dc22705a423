"""Polishing a finished graph: every keyframe is matched again, now against all its neighbours, and the whole is optimised.

While mapping, a scan met only what had been seen before it. Afterwards it meets everything around it, so that errors which a
closure merely spread along a loop are taken out where they arose.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lupin_runtime.slam.keyframes import Edge, KeyframeGraph, relative, turned
from lupin_runtime.slam.local_map import FieldShape, LocalMap
from lupin_runtime.slam.matching import Match, Window, match
from lupin_runtime.slam.pose_graph import Limits, optimise

Array = NDArray[np.floating]


@dataclass(frozen=True)
class RefinementSettings:
    """How a keyframe meets its neighbours: how many, how near, and how far it may move in each round."""

    rounds: tuple[Window, ...] = (Window(0.5, 0.10), Window(0.2, 0.04), Window(0.1, 0.02))
    neighbours: int = 24
    radius_m: float = 6.0
    ties: int = 4
    least_score: float = 0.4
    least_fit: float = 0.6
    least_overlap: float = 0.4
    robust_scale: float = 3.0


def refine_graph(
    graph: KeyframeGraph,
    settings: RefinementSettings | None = None,
    shape: FieldShape | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> None:
    """Move the keyframes of a closed graph to where all their neighbours want them: its edges stay, ties join them."""
    settings = settings or RefinementSettings()
    kept = list(graph.edges)
    local = LocalMap(shape)
    done, total = 0, len(settings.rounds) * len(graph)
    for window in settings.rounds:
        poses = graph.poses.copy()
        tree = cKDTree(poses[:, :2])
        ties: list[Edge] = []
        for number in range(len(graph)):
            ties += _ties(graph, local, tree, poses, number, window, settings)
            done += 1
            if done % 50 == 0:
                progress(done / total)
        graph.replace_edges(kept + ties)
        edges, _ = graph.as_edges()
        solution = optimise(
            poses,
            edges,
            robust=np.ones(len(edges), bool),
            robust_scale=settings.robust_scale,
            limits=Limits(30, 1e-7),
            trust_guess=True,
        )
        graph.poses = solution.poses
    progress(1.0)


def _ties(
    graph: KeyframeGraph, local: LocalMap, tree: cKDTree, poses: Array, number: int, window: Window, s: RefinementSettings
) -> list[Edge]:
    away, near = tree.query(poses[number, :2], k=min(s.neighbours + 1, len(graph)), distance_upper_bound=s.radius_m)
    near = near[np.isfinite(away) & (near != number)]
    if not len(near):
        return []
    local.build(graph.pool, near, poses[near], (float(poses[number, 0]), float(poses[number, 1])))
    scan = graph.pool.scan(number)
    spread = np.diag([window.half_m**2, window.half_m**2, window.half_rad**2])
    fit = match(local, scan, poses[number], spread, window)
    if fit is None or not _holds(fit, s):
        return []
    information = turned(np.linalg.inv(fit.covariance), float(fit.pose[2])) / s.ties
    yaw_gap = np.abs((poses[near, 2] - poses[number, 2] + math.pi) % (2 * math.pi) - math.pi)
    seen_alike = np.argsort(np.hypot(*(poses[near, :2] - fit.pose[:2]).T) + yaw_gap, kind="stable")[: s.ties]
    return [Edge(int(other), number, relative(poses[other], fit.pose), information, True) for other in near[seen_alike]]


def _holds(fit: Match, s: RefinementSettings) -> bool:
    return fit.score >= s.least_score and fit.fit >= s.least_fit and fit.overlap >= s.least_overlap
