"""The optimizer against known optima: closed graphs, a general solver, good and poor guesses."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from lupin_runtime.slam.normal_equations import BlockPattern, Indefinite
from lupin_runtime.slam.pose_graph import (
    Edges,
    GraphError,
    Undetermined,
    anchors_of,
    edge_chi2,
    find_undetermined,
    linear_guess,
    optimize,
    parts_of,
    residuals,
    tree_guess,
)
from lupin_runtime.slam.se2 import wrap


def relative_pose(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    c, s, d = np.cos(a[:, 2]), np.sin(a[:, 2]), b - a
    return np.stack((c * d[:, 0] + s * d[:, 1], -s * d[:, 0] + c * d[:, 1], wrap(d[:, 2])), axis=1)


def random_graph(seed: int, poses: int, loops: int, place: float = 0.05, turn: float = 0.02) -> tuple[np.ndarray, Edges]:
    """Return the true poses, shape (n, 3), and noisy edges of a random walk with closures between random poses."""
    rng = np.random.default_rng(seed)
    truth = np.zeros((poses, 3))
    for k in range(1, poses):
        yaw = truth[k - 1, 2] + rng.choice([0.0, 0.0, 0.0, np.pi / 2, -np.pi / 2])
        truth[k] = truth[k - 1, 0] + np.cos(yaw), truth[k - 1, 1] + np.sin(yaw), yaw
    truth[:, 2] = wrap(truth[:, 2])
    pairs = np.array([sorted(rng.choice(poses, 2, replace=False)) for _ in range(loops)]).reshape(-1, 2)
    tail = np.concatenate((np.arange(poses - 1), pairs[:, 0])).astype(np.int64)
    head = np.concatenate((np.arange(1, poses), pairs[:, 1])).astype(np.int64)
    noise = rng.normal(size=(len(tail), 3)) * [place, place, turn]
    information = np.broadcast_to(np.diag([place**-2, place**-2, turn**-2]), (len(tail), 3, 3)).copy()
    return truth, Edges(tail, head, relative_pose(truth[tail], truth[head]) + noise, information)


def odometry(edges: Edges, poses: int) -> np.ndarray:
    """Poses by dead reckoning: the chain of edges k -> k + 1."""
    guess = np.zeros((poses, 3))
    for k in range(1, poses):
        x, y, yaw = guess[k - 1]
        dx, dy, turn = edges.motion[k - 1]
        guess[k] = x + np.cos(yaw) * dx - np.sin(yaw) * dy, y + np.sin(yaw) * dx + np.cos(yaw) * dy, yaw + turn
    return guess


def general_optimum(start: np.ndarray, edges: Edges) -> float:
    """Return the lowest cost that a general solver finds from `start`, with its first pose fixed."""
    values, vectors = np.linalg.eigh(edges.information)  # they may be semidefinite
    roots = np.sqrt(np.maximum(values, 0.0))[:, :, None] * vectors.transpose(0, 2, 1)

    def cost(free: np.ndarray) -> np.ndarray:
        poses = np.vstack((start[0], free.reshape(-1, 3)))
        result: np.ndarray = np.einsum("eij,ej->ei", roots, residuals(poses, edges)).ravel()
        return result

    return float(2.0 * least_squares(cost, start[1:].ravel(), xtol=1e-12, ftol=1e-12, gtol=1e-12).cost)


@settings(max_examples=25)
@given(seed=st.integers(0, 10_000), scale=st.floats(0.1, 100.0))
def test_exact_measurements_give_the_truth_from_any_guess(seed: int, scale: float) -> None:
    truth, edges = random_graph(seed, 30, 12)
    exact = Edges(edges.tail, edges.head, relative_pose(truth[edges.tail], truth[edges.head]), edges.information)
    guess = np.random.default_rng(seed).normal(size=truth.shape) * scale
    guess[0] = truth[0]
    solution = optimize(guess, exact)
    assert solution.chi2_after < 1e-6
    np.testing.assert_allclose(solution.poses[:, :2], truth[:, :2], atol=1e-5)
    np.testing.assert_allclose(wrap(solution.poses[:, 2] - truth[:, 2]), 0.0, atol=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_optimum_equals_that_of_a_general_solver(seed: int) -> None:
    truth, edges = random_graph(seed, 40, 25)
    reference = general_optimum(truth, edges)
    for guess in (odometry(edges, 40), np.zeros_like(truth), np.random.default_rng(seed).normal(size=truth.shape) * 20):
        guess[0] = truth[0]
        solution = optimize(guess, edges)
        assert solution.chi2_after == pytest.approx(reference, rel=1e-6)
        assert solution.converged


def test_thousands_of_poses_reach_one_optimum_from_any_guess() -> None:
    truth, edges = random_graph(7, 1500, 900, 0.1, 0.1)
    good, poor = optimize(truth, edges), optimize(np.zeros_like(truth), edges)
    assert good.chi2_after == pytest.approx(poor.chi2_after, rel=1e-9)
    assert poor.started_from == "linear"
    # The expected chi2 of a correct model: the number of residuals less the unknowns.
    freedom = 3 * (len(edges) - len(truth) + 1)
    assert abs(good.chi2_after - freedom) < 5 * np.sqrt(2 * freedom)


def test_correlated_information_matrix_is_used_in_full() -> None:
    truth, edges = random_graph(1, 25, 15)
    rng = np.random.default_rng(0)
    root = rng.normal(size=(len(edges), 3, 3)) * 5
    information = root @ root.transpose(0, 2, 1) + np.eye(3)
    edges = Edges(edges.tail, edges.head, edges.motion, information)
    assert optimize(odometry(edges, 25), edges).chi2_after == pytest.approx(general_optimum(truth, edges), rel=1e-6)


VAGUE = {
    "no angle": np.diag([400.0, 400.0, 0.0]),
    "no place": np.diag([0.0, 0.0, 2500.0]),
    "along only": np.diag([400.0, 0.0, 0.0]),
    "nothing": np.zeros((3, 3)),
    "one direction": np.outer([1.0, 2.0, 3.0], [1.0, 2.0, 3.0]) * 100.0,
}


@pytest.mark.parametrize("vague", VAGUE.values(), ids=VAGUE)
@pytest.mark.parametrize("seed", range(3))
def test_semidefinite_closures_reach_the_general_optimum(seed: int, vague: np.ndarray) -> None:
    """The chain of definite edges determines the graph; every closure is semidefinite."""
    truth, edges = random_graph(seed, 30, 12)
    information = edges.information.copy()
    information[29:] = vague
    edges = Edges(edges.tail, edges.head, edges.motion, information)
    solution = optimize(odometry(edges, 30), edges)
    assert solution.converged
    assert solution.chi2_after == pytest.approx(general_optimum(truth, edges), rel=1e-6, abs=1e-6)


def test_enough_position_edges_alone_determine_a_graph() -> None:
    """A robot that three fixed poses place: each edge says where it is, none how it is turned."""
    places = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 1.0], [0.0, 3.0, 2.0], [1.0, 1.0, 0.7]])
    tail, head = np.array([3, 3, 3]), np.array([0, 1, 2])
    vague = np.broadcast_to(VAGUE["no angle"], (3, 3, 3))
    edges = Edges(tail, head, relative_pose(places[tail], places[head]) * [1.0, 1.0, 0.0], vague)
    for guess in (places, places * [1.0, 1.0, 0.0], np.vstack((places[:3], np.zeros(3)))):
        solution = optimize(guess, edges, fixed=np.array([0, 1, 2]))
        assert solution.chi2_after < 1e-9
        np.testing.assert_allclose(solution.poses[3], places[3], atol=1e-6)


@pytest.mark.parametrize(
    ("vague", "free"), [("no angle", "angle"), ("no place", "place"), ("along only", "place|angle"), ("nothing", "place|angle")]
)
def test_vertex_that_edges_leave_free_is_named(vague: str, free: str) -> None:
    truth, edges = random_graph(4, 20, 0)
    information = edges.information.copy()
    information[13] = VAGUE[vague]
    with pytest.raises(Undetermined, match=rf"vertex 14: its ({free}) is free"):
        optimize(truth, Edges(edges.tail, edges.head, edges.motion, information))


def test_thousand_semidefinite_edges_are_judged_by_their_rank() -> None:
    """Each pose has one edge on its place and one on its angle, both semidefinite: together they determine it."""
    truth, edges = random_graph(2, 1000, 0)
    information = np.concatenate((edges.information * [[1, 1, 0]], edges.information * [[0, 0, 1]]))
    both = Edges(np.tile(edges.tail, 2), np.tile(edges.head, 2), np.tile(edges.motion, (2, 1)), information)
    held = anchors_of(1000, both)
    assert find_undetermined(truth, both, held) is None
    information[999 + 700] = 0.0
    found = find_undetermined(truth, both, held)
    assert found is not None and found[0] > 700


def test_spanning_tree_avoids_edges_that_say_nothing() -> None:
    truth, edges = random_graph(8, 40, 25)
    motion, information = relative_pose(truth[edges.tail], truth[edges.head]), edges.information.copy()
    motion[39:], information[39:] = [9.0, -9.0, 1.0], 0.0
    found = tree_guess(40, Edges(edges.tail, edges.head, motion, information))
    np.testing.assert_allclose(found[:, :2], truth[:, :2], atol=1e-9)


def test_fixed_vertices_do_not_move() -> None:
    _, edges = random_graph(2, 20, 10)
    guess = odometry(edges, 20)
    solution = optimize(guess, edges, fixed=np.array([3, 9]))
    np.testing.assert_array_equal(solution.poses[[3, 9]], guess[[3, 9]])
    assert solution.chi2_after > 0.0


def test_each_part_of_a_split_graph_keeps_its_own_frame() -> None:
    _, edges = random_graph(3, 20, 8)
    keep = (edges.tail < 10) == (edges.head < 10)
    split = Edges(edges.tail[keep], edges.head[keep], edges.motion[keep], edges.information[keep])
    assert np.flatnonzero(anchors_of(20, split)).tolist() == [0, 10]
    solution = optimize(odometry(edges, 20), split)
    assert solution.converged and np.isfinite(solution.poses).all()


@settings(max_examples=25)
@given(seed=st.integers(0, 10_000), flips=st.integers(0, 2**32 - 1))
def test_spanning_tree_of_exact_edges_is_the_truth(seed: int, flips: int) -> None:
    truth, edges = random_graph(seed, 30, 12)
    flip = np.array([flips >> k % 32 & 1 for k in range(len(edges))], bool)
    tail, head = np.where(flip, edges.head, edges.tail), np.where(flip, edges.tail, edges.head)
    found = tree_guess(30, Edges(tail, head, relative_pose(truth[tail], truth[head]), edges.information))
    np.testing.assert_allclose(found[:, :2], truth[:, :2], atol=1e-9)
    np.testing.assert_allclose(wrap(found[:, 2] - truth[:, 2]), 0.0, atol=1e-9)


def test_spanning_tree_is_a_better_guess_than_the_chain() -> None:
    """Its paths are short where loops were closed; the chain of odometry adds up the errors of all edges."""
    truth, edges = random_graph(7, 1500, 900, 0.1, 0.05)
    tree, chain = (float(edge_chi2(poses, edges).sum()) for poses in (tree_guess(1500, edges), odometry(edges, 1500)))
    assert tree < 0.5 * chain
    assert optimize(tree_guess(1500, edges), edges).chi2_after == pytest.approx(optimize(truth, edges).chi2_after, rel=1e-6)


def test_parts_of_a_graph_are_listed_largest_first() -> None:
    ends = np.array([[3, 1], [1, 5], [4, 2]])
    edges = Edges(ends[:, 0], ends[:, 1], np.zeros((3, 3)), np.broadcast_to(np.eye(3), (3, 3, 3)))
    assert [part.tolist() for part in parts_of(6, edges)] == [[1, 3, 5], [2, 4], [0]]


def test_linear_guess_of_exact_measurements_is_the_truth() -> None:
    truth, edges = random_graph(5, 50, 30)
    exact = Edges(edges.tail, edges.head, relative_pose(truth[edges.tail], truth[edges.head]), edges.information)
    guess = np.zeros_like(truth)
    guess[0] = truth[0]
    found = linear_guess(guess, exact, anchors_of(50, exact))
    np.testing.assert_allclose(found[:, :2], truth[:, :2], atol=1e-8)


def test_wrong_closure_under_a_robust_kernel_bends_nothing() -> None:
    truth, edges = random_graph(6, 60, 40, 0.02, 0.01)
    wrong = edges.motion.copy()
    wrong[-1] += [4.0, -3.0, 1.0]
    lied = Edges(edges.tail, edges.head, wrong, edges.information)
    soft = np.zeros(len(edges), bool)
    soft[59:] = True
    plain = optimize(truth, lied)
    robust = optimize(truth, lied, robust=soft)
    correct = optimize(truth, edges)
    off = np.hypot(*(robust.poses - correct.poses)[:, :2].T).max()
    assert off < 0.05
    assert np.hypot(*(plain.poses - correct.poses)[:, :2].T).max() > 4 * off
    assert edge_chi2(robust.poses, lied).argmax() == len(edges) - 1


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda e: Edges(e.tail, e.head + 100, e.motion, e.information), "names vertex"),
        (lambda e: Edges(e.tail, e.tail, e.motion, e.information), "with itself"),
        (lambda e: Edges(e.tail, e.head, e.motion * np.nan, e.information), "not finite"),
        (lambda e: Edges(e.tail, e.head, e.motion, -e.information), "positive definite"),
    ],
)
def test_invalid_graph_is_refused_with_its_reason(spoil: Callable[..., Any], says: str) -> None:
    truth, edges = random_graph(0, 10, 3)
    with pytest.raises(GraphError, match=says):
        optimize(truth, spoil(edges))


def test_graph_without_edges_stays_unchanged() -> None:
    nothing = Edges(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)))
    poses = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 0.1]])
    np.testing.assert_array_equal(optimize(poses, nothing).poses, poses)
    np.testing.assert_array_equal(optimize(poses[:1], nothing).poses, poses[:1])


def test_graph_with_all_vertices_fixed_stays_unchanged() -> None:
    truth, edges = random_graph(4, 12, 5)
    solution = optimize(truth, edges, fixed=np.arange(12))
    np.testing.assert_array_equal(solution.poses, truth)
    assert solution.chi2_after == pytest.approx(solution.chi2_before)


@settings(max_examples=25)
@given(seed=st.integers(0, 10_000), k=st.sampled_from([2, 3]), damping=st.sampled_from([0.0, 0.5]))
def test_block_solver_equals_a_dense_one(seed: int, k: int, damping: float) -> None:
    rng = np.random.default_rng(seed)
    vertices, count = 9, 20
    ends = np.array([rng.choice(vertices, 2, replace=False) for _ in range(count)])
    held = rng.random(vertices) < 0.3
    factors = rng.normal(size=(count, 2 * k, 2 * k))
    blocks = factors @ factors.transpose(0, 2, 1) + np.eye(2 * k)  # of tail and head together
    right = rng.normal(size=(count, 2 * k))
    dense, vector = np.zeros((vertices * k,) * 2), np.zeros(vertices * k)
    for (tail, head), block, share in zip(ends, blocks, right):
        at = np.concatenate((tail * k + np.arange(k), head * k + np.arange(k)))
        dense[np.ix_(at, at)] += block
        vector[at] += share
    used = np.unique(ends)
    keep = np.isin(np.arange(vertices), used) & ~held
    rows = (np.flatnonzero(keep)[:, None] * k + np.arange(k)).ravel()
    matrix = dense[np.ix_(rows, rows)]
    matrix = matrix + damping * np.diag(np.diag(matrix))
    pattern = BlockPattern(vertices, ends[:, 0], ends[:, 1], ~keep)
    found = pattern.solve(blocks[:, :k, :k], blocks[:, :k, k:], blocks[:, k:, k:], right[:, :k], right[:, k:], damping)
    np.testing.assert_allclose(
        found[np.flatnonzero(keep)].ravel(), np.linalg.solve(matrix, vector[rows]), rtol=1e-8, atol=1e-10
    )


def test_indefinite_equations_are_refused() -> None:
    ends = np.array([[0, 1], [1, 2]])
    pattern = BlockPattern(3, ends[:, 0], ends[:, 1], np.array([True, False, False]))
    flat = -np.broadcast_to(np.eye(3), (2, 3, 3))
    with pytest.raises(Indefinite):
        pattern.solve(flat, -flat, flat, np.zeros((2, 3)), np.zeros((2, 3)))
