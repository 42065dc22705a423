"""Least squares on SE(2) pose graphs: sparse Levenberg-Marquardt from a guess or from a linear initialization.

A pose is (x, y, yaw) in meters and radians; an edge is the pose of its head in the frame of its tail. The cost is g2o's:
chi2 = sum of e' Omega e, with e the translation and yaw of measurement^-1 * tail^-1 * head, the yaw wrapped.
"""

from __future__ import annotations

import contextlib
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, diags
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree
from scipy.sparse.linalg import splu

from lupin_runtime.slam.normal_equations import BlockPattern, Indefinite, adjacency
from lupin_runtime.slam.se2 import wrap

Array = NDArray[np.floating]
Index = NDArray[np.int64]


SINGULAR = 1e-9  # an information matrix whose scaled eigenvalue is at most this says nothing of some direction
NOT_SEMIDEFINITE = "neither positive definite nor semidefinite"


class GraphError(ValueError):
    """An invalid graph: an edge without its vertex, or an information matrix with a negative eigenvalue."""


class Undetermined(GraphError):
    """A vertex of whose place or angle no edges say anything; `vertex` is its index, `free` what is free."""

    def __init__(self, vertex: int, free: str) -> None:
        self.vertex, self.free = vertex, free
        super().__init__(f"the edges do not determine vertex {vertex}: its {free} is free")


def scaled_eigenvalue(information: Array) -> Array:
    """Return the least eigenvalue of matrices (..., 3, 3) that are scaled to ones on their diagonals: meters and radians do
    not compare. A zero on the diagonal stays."""
    diagonal = np.diagonal(information, axis1=-2, axis2=-1)
    root = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    return np.asarray(np.linalg.eigvalsh(information / (root[..., :, None] * root[..., None, :]))[..., 0])


@dataclass(frozen=True)
class Edges:
    """Relative poses: `tail` and `head` (E,) index poses, `motion` (E, 3) is tail_from_head, `information` (E, 3, 3) its
    inverse covariance in the order x, y, yaw."""

    tail: Index
    head: Index
    motion: Array
    information: Array

    def __len__(self) -> int:
        return len(self.tail)

    def check(self, poses: int) -> None:
        """Raise GraphError unless every edge joins two of `poses` vertices with a usable measurement."""
        if not len(self):
            return
        for ends in (self.tail, self.head):
            if ends.min() < 0 or ends.max() >= poses:
                raise GraphError(f"an edge names vertex {ends.min() if ends.min() < 0 else ends.max()} of {poses}")
        if (loops := np.flatnonzero(self.tail == self.head)).size:
            raise GraphError(f"edge {loops[0]} joins vertex {self.tail[loops[0]]} with itself")
        if not (np.isfinite(self.motion).all() and np.isfinite(self.information).all()):
            raise GraphError("a measurement or an information matrix is not finite")
        if (bad := np.flatnonzero(scaled_eigenvalue(self.information) < -SINGULAR)).size:
            raise GraphError(f"the information matrix of edge {bad[0]} is {NOT_SEMIDEFINITE}")


@dataclass(frozen=True)
class Solution:
    """The result of `optimize`: poses (N, 3), g2o's chi2 before and after, its initial guess, its accepted steps."""

    poses: Array
    chi2_before: float
    chi2_after: float
    iterations: int
    converged: bool
    started_from: str
    seconds: float


def residuals(poses: Array, edges: Edges) -> Array:
    """Errors (E, 3) of the edges at these poses."""
    tail, head = poses[edges.tail], poses[edges.head]
    turn = tail[:, 2] + edges.motion[:, 2]
    c, s = np.cos(turn), np.sin(turn)
    cz, sz = np.cos(edges.motion[:, 2]), np.sin(edges.motion[:, 2])
    dx, dy = head[:, 0] - tail[:, 0], head[:, 1] - tail[:, 1]
    mx, my = edges.motion[:, 0], edges.motion[:, 1]
    return np.stack(
        (
            c * dx + s * dy - cz * mx - sz * my,
            -s * dx + c * dy + sz * mx - cz * my,
            wrap(head[:, 2] - turn),
        ),
        axis=1,
    )


def edge_chi2(poses: Array, edges: Edges) -> Array:
    """Every edge's share (E,) of the cost."""
    e = residuals(poses, edges)
    return np.asarray(np.einsum("ei,eij,ej->e", e, edges.information, e))


def _jacobians(poses: Array, edges: Edges) -> tuple[Array, Array]:
    """Derivatives (E, 3, 3) of the residuals by the tail's and the head's pose."""
    tail, head = poses[edges.tail], poses[edges.head]
    turn = tail[:, 2] + edges.motion[:, 2]
    c, s = np.cos(turn), np.sin(turn)
    dx, dy = head[:, 0] - tail[:, 0], head[:, 1] - tail[:, 1]
    by_head = np.zeros((len(edges), 3, 3))
    by_head[:, 0, 0] = by_head[:, 1, 1] = c
    by_head[:, 0, 1], by_head[:, 1, 0] = s, -s
    by_head[:, 2, 2] = 1.0
    by_tail = -by_head
    by_tail[:, 0, 2] = -s * dx + c * dy
    by_tail[:, 1, 2] = -c * dx - s * dy
    return by_tail, by_head


def anchors_of(poses: int, edges: Edges, fixed: Index | None = None) -> NDArray[np.bool_]:
    """Select the vertices (N,) to hold: the `fixed` ones, and the first vertex of every connected part without one."""
    held = np.zeros(poses, dtype=bool)
    if fixed is not None:
        held[fixed] = True
    _, part = connected_components(adjacency(poses, edges.tail, edges.head), directed=False)
    parts, first = np.unique(part, return_index=True)
    free_parts = np.setdiff1d(parts, part[held])
    held[first[np.isin(parts, free_parts)]] = True
    return held


def parts_of(poses: int, edges: Edges) -> list[Index]:
    """The connected parts of the graph, each as ascending indices of its vertices; the largest part first."""
    _, part = connected_components(adjacency(poses, edges.tail, edges.head), directed=False)
    order = np.argsort(part, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(part[order])) + 1)
    return sorted((np.asarray(members, dtype=np.int64) for members in parts), key=len, reverse=True)


def tree_guess(poses: int, edges: Edges, fixed: Index | None = None) -> Array:
    """Compute poses (N, 3) from the edges alone: along a breadth-first spanning tree of every part, from its first `fixed` or
    first vertex, which is at the origin. The errors of few edges add up on its short paths.

    Edges that say something of every direction come first.
    As g2o initializes graphs without vertices: Kuemmerle et al., "g2o: a general framework for graph optimization", ICRA 2011.
    """
    result = np.zeros((poses, 3))
    edge_between: dict[tuple[int, int], tuple[int, bool]] = {}
    definite = scaled_eigenvalue(edges.information) > SINGULAR
    for index in [*np.flatnonzero(definite).tolist(), *np.flatnonzero(~definite).tolist()]:
        tail, head = int(edges.tail[index]), int(edges.head[index])
        edge_between.setdefault((tail, head), (index, True))
        edge_between.setdefault((head, tail), (index, False))
    graph = adjacency(poses, edges.tail, edges.head)
    if not definite.all():
        graph = minimum_spanning_tree(_cost_of_edges(poses, edges, definite))
    held = np.zeros(poses, dtype=bool) if fixed is None else np.isin(np.arange(poses), fixed)
    for part in parts_of(poses, edges):
        root = part[held[part]][0] if held[part].any() else part[0]
        order, before = breadth_first_order(graph, root, directed=False)
        for vertex in order[1:].tolist():
            x, y, yaw = result[before[vertex]]
            index, forward = edge_between[int(before[vertex]), vertex]
            dx, dy, turn = edges.motion[index]
            if not forward:
                c, s = np.cos(turn), np.sin(turn)
                dx, dy, turn = -c * dx - s * dy, s * dx - c * dy, -turn
            c, s = np.cos(yaw), np.sin(yaw)
            result[vertex] = x + c * dx - s * dy, y + s * dx + c * dy, wrap(yaw + turn)
    return result


def _cost_of_edges(poses: int, edges: Edges, definite: NDArray[np.bool_]) -> csr_matrix:
    """An (N, N) matrix with the cost of a step along the edges: a tree takes an indefinite one only where it must."""
    best: dict[tuple[int, int], float] = {}
    for tail, head, good in zip(edges.tail.tolist(), edges.head.tolist(), definite.tolist()):
        pair = (min(tail, head), max(tail, head))
        best[pair] = min(best.get(pair, np.inf), 1.0 if good else 2.0)
    ends = np.array(list(best), dtype=np.int64).reshape(-1, 2)
    return csr_matrix((np.array(list(best.values())), (ends[:, 0], ends[:, 1])), shape=(poses, poses))


def find_undetermined(poses: Array, edges: Edges, held: NDArray[np.bool_]) -> tuple[int, str] | None:
    """Return a vertex that the edges leave free at these poses, and whether its place or its angle is free; None if all are
    determined.

    Vertices that definite edges join move as one rigid body. The other edges must hold all bodies without a held vertex: their
    cost over the bodies' motions has a null vector if not, which inverse iteration finds.
    """
    definite = scaled_eigenvalue(edges.information) > SINGULAR
    if definite.all():
        return None
    _, body = connected_components(adjacency(len(poses), edges.tail[definite], edges.head[definite]), directed=False)
    loose_bodies, first = np.unique(body, return_index=True)
    is_loose = ~np.isin(loose_bodies, body[held])
    loose_bodies, first = loose_bodies[is_loose], first[is_loose]
    if not len(loose_bodies):
        return None
    column = np.full(body.max() + 1, -1, dtype=np.int64)
    column[loose_bodies] = np.arange(len(loose_bodies))
    pivot = np.zeros((body.max() + 1, 2))
    pivot[loose_bodies] = poses[first, :2]
    values, vectors = np.linalg.eigh(edges.information)
    root = np.sqrt(np.maximum(values, 0.0))[:, :, None] * vectors.transpose(0, 2, 1)
    rows, columns, entries = [], [], []
    for ends, jacobian in zip((edges.tail, edges.head), _jacobians(poses, edges)):
        used = np.flatnonzero(~definite & (column[body[ends]] >= 0))
        ends = ends[used]
        arm = poses[ends, :2] - pivot[body[ends]]
        motion = np.broadcast_to(np.eye(3), (len(used), 3, 3)).copy()
        motion[:, 0, 2], motion[:, 1, 2] = -arm[:, 1], arm[:, 0]
        block = root[used] @ jacobian[used] @ motion
        at = np.broadcast_to(np.arange(3), block.shape)
        rows.append((3 * used[:, None, None] + at.transpose(0, 2, 1)).ravel())
        columns.append((3 * column[body[ends]][:, None, None] + at).ravel())
        entries.append(block.ravel())
    shape = (3 * len(edges), 3 * len(loose_bodies))
    jacobian = csr_matrix((np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns))), shape=shape)
    scale = np.sqrt(np.asarray(jacobian.multiply(jacobian).sum(axis=0)).ravel())
    scaled = jacobian @ diags(1.0 / np.where(scale > 0.0, scale, 1.0))
    normal = (scaled.T @ scaled).tocsc()
    factor = splu(normal + 1e-13 * diags(np.ones(shape[1]), format="csc"))
    null = np.random.default_rng(0).normal(size=shape[1])
    for _ in range(4):
        null = factor.solve(null)
        null /= np.linalg.norm(null)
    if float(null @ (normal @ null)) > 1e-12:
        return None
    most = int(np.argmax(np.abs(null)))
    return int(first[most // 3]), "angle" if most % 3 == 2 else "place"


def linear_guess(poses: Array, edges: Edges, held: NDArray[np.bool_], pattern: BlockPattern | None = None) -> Array:
    """Compute an initial guess: chordal rotations, then translations, both by linear least squares.

    Carlone, Tron, Daniilidis, Dellaert, "Initialization techniques for 3D SLAM", ICRA 2015; in the plane a rotation is a
    complex number. Only the held poses are read.
    """
    free = np.flatnonzero(~held)
    if not len(free):
        return poses.copy()
    pattern = pattern or BlockPattern(len(poses), edges.tail, edges.head, held)
    # z_head = z_tail * exp(i yaw), weighted with the yaw's information; a complex number is a pair of reals.
    # An edge without information on the angle counts a little: where no other does, its measurement is better than nothing.
    turns_weight = edges.information[:, 2, 2]
    weight = np.maximum(turns_weight, 1e-9 * turns_weight.max(initial=1e-9))[:, None, None]
    step = _rotations(edges.motion[:, 2])
    known = np.where(held[:, None], np.stack((np.cos(poses[:, 2]), np.sin(poses[:, 2])), axis=1), 0.0)
    identity = np.broadcast_to(np.eye(2), step.shape) * weight
    back = (weight * step).transpose(0, 2, 1)
    turns = pattern.solve(
        identity,
        -back,
        identity,
        np.einsum("eij,ej->ei", back, known[edges.head]),
        np.einsum("eji,ej->ei", back, known[edges.tail]),
    )
    result = poses.copy()
    result[free, 2] = np.arctan2(turns[free, 1], turns[free, 0])

    rotation = _rotations(result[edges.tail, 2])
    offset = np.einsum("eij,ej->ei", rotation, edges.motion[:, :2])
    turn = np.matmul(rotation, step)
    place_information = edges.information[:, :2, :2].copy()
    vague = scaled_eigenvalue(edges.information) <= SINGULAR
    place_information[vague] += 1e-9 * place_information.max(initial=1e-9) * np.eye(2)
    metric = np.einsum("eij,ejk,elk->eil", turn, place_information, turn)
    place = np.where(held[:, None], poses[:, :2], 0.0)
    pull = np.einsum("eij,ej->ei", metric, offset + place[edges.tail] - place[edges.head])
    result[free, :2] = pattern.solve(metric, -metric, metric, -pull, pull)[free]
    return result


def _rotations(yaw: Array) -> Array:
    """Rotation matrices (E, 2, 2)."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack((np.stack((c, -s), 1), np.stack((s, c), 1)), 1)


def _step(pattern: BlockPattern, blocks: tuple[Array, Array, Array, Array, Array], poses: int, damping: float) -> Array:
    """The damped Gauss-Newton step (N, 3), with more damping if the equations are indefinite."""
    step = np.zeros((poses, 3))
    while True:
        try:
            found = pattern.solve(*blocks, damping)
        except Indefinite:
            if damping > 1e8:
                return step
            damping = max(10.0 * damping, 1e-6)
            continue
        step[: len(found)] = found
        return step


@dataclass(frozen=True)
class Limits:
    """When `optimize` stops. `relative_gain` is the smallest relative decrease of the cost for another step."""

    iterations: int = 100
    relative_gain: float = 1e-10
    budget_s: float = float("inf")


def optimize(
    poses: Array,
    edges: Edges,
    fixed: Index | None = None,
    robust: NDArray[np.bool_] | None = None,
    robust_scale: float = 3.0,
    limits: Limits | None = None,
    trust_guess: bool = False,
) -> Solution:
    """Find the poses with the lowest chi2.

    Starts from the better of the guess and `linear_guess`, so that a poor guess does no harm; `trust_guess` skips the
    comparison. `robust` (E,) marks edges under a Cauchy kernel of `robust_scale` sigma: closures that may be wrong.
    Raises GraphError, Undetermined where semidefinite edges leave a vertex free.
    """
    started = time.perf_counter()
    limits = limits or Limits()
    poses = np.array(poses, dtype=float)
    if poses.ndim != 2 or poses.shape[1] != 3 or not np.isfinite(poses).all():
        raise GraphError(f"poses must be finite (N, 3), not {poses.shape}")
    edges.check(len(poses))
    chi2_before = float(edge_chi2(poses, edges).sum())
    if not len(edges) or len(poses) < 2:
        return Solution(poses, chi2_before, chi2_before, 0, True, "guess", time.perf_counter() - started)
    held = anchors_of(len(poses), edges, fixed)
    pattern = BlockPattern(len(poses), edges.tail, edges.head, held)
    soft = np.zeros(len(edges), dtype=bool) if robust is None else robust
    squared = robust_scale * robust_scale

    def cost_of(candidate: Array) -> tuple[float, Array]:
        chi2 = edge_chi2(candidate, edges)
        return float(np.where(soft, squared * np.log1p(chi2 / squared), chi2).sum()), chi2

    start, (cost, chi2) = "guess", cost_of(poses)
    if not trust_guess:
        # Matrices that are hardly positive definite give no linear guess; the iterations then start from the given one.
        with contextlib.suppress(Indefinite):
            linear = linear_guess(poses, edges, held, pattern)
            linear_cost = cost_of(linear)
            if linear_cost[0] < cost:
                start, poses, (cost, chi2) = "linear", linear, linear_cost

    damping, steps, converged = 0.0, 0, False
    while steps < limits.iterations and not converged:
        weight = np.where(soft, 1.0 / (1.0 + chi2 / squared), 1.0)
        information = edges.information * weight[:, None, None]
        by_tail, by_head = _jacobians(poses, edges)
        error = residuals(poses, edges)
        tail_metric = np.matmul(by_tail.transpose(0, 2, 1), information)
        head_metric = np.matmul(by_head.transpose(0, 2, 1), information)
        blocks = (
            np.matmul(tail_metric, by_tail),
            np.matmul(tail_metric, by_head),
            np.matmul(head_metric, by_head),
            -np.matmul(tail_metric, error[:, :, None])[:, :, 0],
            -np.matmul(head_metric, error[:, :, None])[:, :, 0],
        )
        while True:
            step = _step(pattern, blocks, len(poses), damping)
            candidate = poses + step
            candidate[~held, 2] = wrap(candidate[~held, 2])
            new_cost, new_chi2 = cost_of(candidate)
            if new_cost <= cost or damping > 1e8:
                break
            damping = max(10.0 * damping, 1e-6)
        if new_cost > cost:
            converged = True  # no step of any length decreases the cost: it is at its minimum within rounding
            break
        converged = cost - new_cost <= limits.relative_gain * max(cost, 1e-12)
        poses, cost, chi2 = candidate, new_cost, new_chi2
        damping = damping / 10.0 if damping > 1e-6 else 0.0
        steps += 1
        if time.perf_counter() - started > limits.budget_s:
            break
    if (undetermined := find_undetermined(poses, edges, held)) is not None:
        raise Undetermined(*undetermined)
    return Solution(poses, chi2_before, float(chi2.sum()), steps, converged, start, time.perf_counter() - started)
