"""Refines a finished graph: matches every keyframe again, now against all its neighbors, and optimizes the whole graph.

While mapping, a scan is matched only against earlier ones. Here it is matched against everything around it, which removes
errors where they arose, whereas a loop closure only spreads them along the loop.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lupin_runtime.slam.keyframes import Edge, KeyframeGraph
from lupin_runtime.slam.local_map import FieldShape, LocalMap
from lupin_runtime.slam.pose_graph import Limits, optimize
from lupin_runtime.slam.scan_matching import Match, Window, match
from lupin_runtime.slam.se2 import relative_pose, rotate_information

Array = NDArray[np.floating]


@dataclass(frozen=True)
class RefinementSettings:
    """How keyframes are matched again: search window of each round, number and distance of neighbors, acceptance limits."""

    rounds: tuple[Window, ...] = (Window(0.5, 0.10), Window(0.2, 0.04), Window(0.1, 0.02))
    neighbors: int = 24
    radius_m: float = 6.0
    ties: int = 4
    min_score: float = 0.4
    min_fit: float = 0.6
    min_overlap: float = 0.4
    robust_scale: float = 3.0


def refine_graph(
    graph: KeyframeGraph,
    settings: RefinementSettings | None = None,
    shape: FieldShape | None = None,
    progress: Callable[[float], None] = lambda _share: None,
) -> None:
    """Move the keyframes of a closed graph to where they fit all their neighbors best.

    The graph keeps its edges and gains edges to neighbors (`ties`). `progress` receives the finished share, 0 to 1."""
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
        solution = optimize(
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
    away, near = tree.query(poses[number, :2], k=min(s.neighbors + 1, len(graph)), distance_upper_bound=s.radius_m)
    near = near[np.isfinite(away) & (near != number)]
    if not len(near):
        return []
    local.build(graph.pool, near, poses[near], (float(poses[number, 0]), float(poses[number, 1])))
    scan = graph.pool.scan(number)
    spread = np.diag([window.half_m**2, window.half_m**2, window.half_rad**2])
    fit = match(local, scan, poses[number], spread, window)
    if fit is None or not _is_accepted(fit, s):
        return []
    information = rotate_information(np.linalg.inv(fit.covariance), float(fit.pose[2])) / s.ties
    yaw_gap = np.abs((poses[near, 2] - poses[number, 2] + math.pi) % (2 * math.pi) - math.pi)
    most_similar = np.argsort(np.hypot(*(poses[near, :2] - fit.pose[:2]).T) + yaw_gap, kind="stable")[: s.ties]
    return [Edge(int(other), number, relative_pose(poses[other], fit.pose), information, True) for other in near[most_similar]]


def _is_accepted(fit: Match, s: RefinementSettings) -> bool:
    return fit.score >= s.min_score and fit.fit >= s.min_fit and fit.overlap >= s.min_overlap
