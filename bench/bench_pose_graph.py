"""The pose graph optimizer on a Manhattan world of 3500 nodes and 5500 edges, from odometry and from poor initial guesses.

`excess` is relative to the best chi2 that any solver found. The reference solver, for chi2 and speed, is a textbook
Gauss-Newton (complex numbers for poses, numeric Jacobian, SciPy's sparse solver) that starts at the ground truth, the easiest
initial guess.
"""

from __future__ import annotations

import sys
import time
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_diag, csr_matrix
from scipy.sparse.linalg import spsolve
from scipy.spatial import cKDTree

from bench.runner import Figures, benchmark
from lupin_runtime.slam.pose_graph import Edges, edge_chi2, optimize
from lupin_runtime.slam.se2 import wrap

Array = NDArray[np.float64]


def make_manhattan_graph(seed: int, node_count: int, edge_count: int, sigma_xy: float, sigma_yaw: float) -> tuple[Array, Edges]:
    """Return the true poses (n, 3) of a walk on a grid, and edges with Gaussian noise (m, rad): odometry and loop closures."""
    rng = np.random.default_rng(seed)
    walk = [(0, 0, 0)]
    heading = 0
    directions = ((1, 0), (0, 1), (-1, 0), (0, -1))
    while len(walk) < node_count:
        for _ in range(rng.integers(1, 6)):
            x, y, _ = walk[-1]
            if max(abs(x + directions[heading][0]), abs(y + directions[heading][1])) > 20:
                heading = (heading + 2) % 4
            walk.append((x + directions[heading][0], y + directions[heading][1], heading))
        heading = (heading + rng.choice((-1, 1))) % 4
    truth = np.array(walk[:node_count], float)
    truth[:, 2] = wrap(truth[:, 2] * np.pi / 2)
    near = np.sort(cKDTree(truth[:, :2]).query_pairs(1.01, output_type="ndarray"), axis=1)
    near = near[near[:, 1] - near[:, 0] > 10]
    near = near[rng.choice(len(near), edge_count - node_count + 1, replace=False)]
    tail = np.concatenate((np.arange(node_count - 1), near[:, 0])).astype(np.int64)
    head = np.concatenate((np.arange(1, node_count), near[:, 1])).astype(np.int64)
    a, b = truth[tail], truth[head]
    c, s, d = np.cos(a[:, 2]), np.sin(a[:, 2]), b - a
    motion = np.stack((c * d[:, 0] + s * d[:, 1], -s * d[:, 0] + c * d[:, 1], wrap(d[:, 2])), axis=1)
    motion = motion + rng.normal(size=motion.shape) * [sigma_xy, sigma_xy, sigma_yaw]
    information = np.broadcast_to(np.diag([sigma_xy**-2, sigma_xy**-2, sigma_yaw**-2]), (len(tail), 3, 3)).copy()
    return truth, Edges(tail, head, motion, information)


def dead_reckoned(edges: Edges, nodes: int) -> Array:
    """Return the poses that follow from the odometry edges alone."""
    poses = np.zeros((nodes, 3))
    for k in range(1, nodes):
        x, y, yaw = poses[k - 1]
        dx, dy, turn = edges.motion[k - 1]
        poses[k] = x + np.cos(yaw) * dx - np.sin(yaw) * dy, y + np.sin(yaw) * dx + np.cos(yaw) * dy, yaw + turn
    return poses


def solve_reference(truth: Array, edges: Edges) -> tuple[float, float]:
    """Return chi2 and seconds of the reference solver, which starts at the ground truth and keeps the first pose fixed."""
    began = time.perf_counter()
    nodes, m = len(truth), edges.motion
    position, yaw = truth[:, 0] + 1j * truth[:, 1], truth[:, 2].copy()
    measured = m[:, 0] + 1j * m[:, 1]

    def error(tail_p: Array, tail_yaw: Array, head_p: Array, head_yaw: Array) -> Array:
        offset = (np.exp(-1j * tail_yaw) * (head_p - tail_p) - measured) * np.exp(-1j * m[:, 2])
        return np.stack((offset.real, offset.imag, np.angle(np.exp(1j * (head_yaw - tail_yaw - m[:, 2])))), axis=1)

    step = 1e-6
    moves = ((step, 0.0), (1j * step, 0.0), (0.0, step))
    rows = np.arange(3 * len(edges)).reshape(-1, 3)
    weights = block_diag(list(edges.information), format="csr")
    for _ in range(50):
        ends = (position[edges.tail], yaw[edges.tail], position[edges.head], yaw[edges.head])
        e = error(*ends)
        data, row, column = [], [], []
        for k, (dp, dyaw) in enumerate(moves):
            for at, vertex in ((0, edges.tail), (2, edges.head)):
                plus, minus = list(ends), list(ends)
                plus[at], plus[at + 1] = plus[at] + dp, plus[at + 1] + dyaw
                minus[at], minus[at + 1] = minus[at] - dp, minus[at + 1] - dyaw
                data.append((error(*plus) - error(*minus)).ravel() / (2 * step))
                row.append(rows.ravel())
                column.append(np.repeat(3 * vertex + k, 3))
        jacobian = csr_matrix(
            (np.concatenate(data), (np.concatenate(row), np.concatenate(column))), shape=(3 * len(edges), 3 * nodes)
        )[:, 3:]
        gradient = jacobian.T @ (weights @ e.ravel())
        change = spsolve((jacobian.T @ weights @ jacobian).tocsc(), -gradient).reshape(-1, 3)
        position[1:] += change[:, 0] + 1j * change[:, 1]
        yaw[1:] += change[:, 2]
        if np.abs(change).max() < 1e-7:
            break
    e = error(position[edges.tail], yaw[edges.tail], position[edges.head], yaw[edges.head])
    return float(np.einsum("ei,eij,ej->", e, edges.information, e)), time.perf_counter() - began


@benchmark(at_most={"excess": 1e-6, "seconds": 1.0})
def main(
    nodes: Annotated[int, "make a graph with this many nodes"] = 3500,
    edges: Annotated[int, "make a graph with this many edges"] = 5500,
) -> Figures:
    """Optimize from every initial guess."""
    figures: dict[str, dict[str, Any]] = {}
    for name, sigma_xy, sigma_yaw in (
        ("usual noise", 0.05, 0.02),
        ("large noise", 0.1, 0.1),
        ("rotation noise, σ = 11°", 0.1, 0.2),
    ):
        truth, graph = make_manhattan_graph(7, nodes, edges, sigma_xy, sigma_yaw)
        rng = np.random.default_rng(0)
        reference_chi2, reference_s = solve_reference(truth, graph)
        guesses = {
            "odometry": dead_reckoned(graph, nodes),
            "random, σ = 30 m": rng.normal(size=truth.shape) * (30.0, 30.0, 3.0),
            "all at the origin": np.zeros_like(truth),
        }
        solutions = {guess_name: optimize(guess, graph) for guess_name, guess in guesses.items()}
        best_chi2 = min(reference_chi2, *(solution.chi2_after for solution in solutions.values()))
        figures[name] = {
            guess_name: {
                "chi2_guess": float(edge_chi2(guesses[guess_name], graph).sum()),
                "chi2": solution.chi2_after,
                "best_chi2": best_chi2,
                "excess": solution.chi2_after / best_chi2 - 1.0,
                "iterations": solution.iterations,
                "seconds": solution.seconds,
                "reference_seconds_from_truth": reference_s,
                "ratio_to_reference": solution.seconds / reference_s,
            }
            for guess_name, solution in solutions.items()
        }
    return figures


if __name__ == "__main__":
    sys.exit(main())
