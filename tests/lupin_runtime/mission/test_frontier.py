"""Frontiers, compared with a cell-by-cell implementation of their definition."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from lupin_runtime.gridmap import GridMap
from lupin_runtime.mission.frontier import FrontierSettings, find_frontiers, frontier_cells, select_frontier_goal

cells = hnp.arrays(
    np.int8,
    hnp.array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=14),
    elements=st.sampled_from([-1, 0, 20, 21, 64, 65, 100]),
)


def _reference_frontier_cells(grid: np.ndarray[Any, Any], radius: int, free: int, occupied: int) -> np.ndarray[Any, Any]:
    height, width = grid.shape
    result = np.zeros(grid.shape, bool)
    for r in range(height):
        for c in range(width):
            neighbors = [(r + 1, c), (r - 1, c), (r, c + 1), (r, c - 1)]
            unknown = any(0 <= a < height and 0 <= b < width and grid[a, b] == -1 for a, b in neighbors)
            square = grid[max(0, r - radius) : r + radius + 1, max(0, c - radius) : c + radius + 1]
            result[r, c] = 0 <= grid[r, c] <= free and unknown and not (square >= occupied).any()
    return result


@given(cells, st.integers(0, 3))
@settings(max_examples=150)
def test_frontier_cells_match_definition(grid: np.ndarray[Any, Any], radius: int) -> None:
    expected = _reference_frontier_cells(grid, radius, 20, 65)
    found = frontier_cells(GridMap(grid, 0.05, 0.0, 0.0), FrontierSettings(radius_cells=radius))
    np.testing.assert_array_equal(found, expected)


@given(cells, st.integers(1, 4))
@settings(max_examples=150)
def test_clusters_are_connected_and_large_enough(grid: np.ndarray[Any, Any], least: int) -> None:
    settings_ = FrontierSettings(radius_cells=0, min_cluster_cells=least)
    grid_map = GridMap(grid, 0.1, -1.0, 2.0)
    mask = frontier_cells(grid_map, settings_)
    clusters = _flood(mask)
    kept = [cluster for cluster in clusters if len(cluster) >= least]
    found = find_frontiers(grid_map, None, settings_)
    assert sorted(f.cluster_size for f in found) == sorted(map(len, kept))
    for frontier in found:
        assert frontier.num_clusters == len(kept)
        cell = grid_map.cell_of(frontier.x, frontier.y)
        (cluster,) = [c for c in kept if cell in c]
        mean = np.mean(cluster, axis=0)
        distances = [np.hypot(*(np.array(member) - mean)) for member in cluster]
        assert math.isclose(np.hypot(*(np.array(cell) - mean)), min(distances), abs_tol=1e-9)


def _flood(mask: np.ndarray[Any, Any]) -> list[list[tuple[int, int]]]:
    left = {(int(r), int(c)) for r, c in zip(*np.nonzero(mask))}
    clusters = []
    while left:
        todo, cluster = [left.pop()], []
        while todo:
            r, c = todo.pop()
            cluster.append((r, c))
            near = {(r + i, c + j) for i in (-1, 0, 1) for j in (-1, 0, 1)} & left
            left -= near
            todo += near
        clusters.append(cluster)
    return clusters


def _two_rooms() -> GridMap:
    """Return a map that is free in the middle, and unknown on the left (a long frontier) and on the right (a short one)."""
    grid = np.full((60, 100), 100, np.int8)
    grid[10:50, 20:80] = 0
    grid[15:45, 19] = -1
    grid[20:32, 80] = -1
    return GridMap(grid, 0.05, 0.0, 0.0)


def test_score_weighs_size_and_distance() -> None:
    settings_ = FrontierSettings(radius_cells=0)
    near_right = select_frontier_goal(_two_rooms(), (3.9, 1.3), settings_)
    nowhere = select_frontier_goal(_two_rooms(), None, settings_)
    assert near_right is not None and near_right.x > 3.5
    assert near_right.score == near_right.cluster_size / (1.0 + math.hypot(near_right.x - 3.9, near_right.y - 1.3))
    assert nowhere is not None and nowhere.x < 1.5
    assert nowhere.score == nowhere.cluster_size == 30


def test_equal_clusters_are_ordered_by_first_cell() -> None:
    grid = np.zeros((30, 30), np.int8)
    grid[5, 5:15] = -1
    grid[20, 5:15] = -1
    goal = select_frontier_goal(GridMap(grid, 0.05, 0.0, 0.0), None)
    assert goal is not None and goal.y < 0.5


def test_clearance_is_in_meters() -> None:
    assert FrontierSettings().radius(0.05) == 7
    assert FrontierSettings().radius(0.1) == 4
    assert FrontierSettings(radius_cells=2).radius(0.05) == 2
    grid = np.zeros((40, 40), np.int8)
    grid[:, 30:] = -1
    grid[:, 22] = 100  # 0.35 m before the frontier at column 29
    assert select_frontier_goal(GridMap(grid, 0.05, 0.0, 0.0), None) is None
    grid[:, 22], grid[:, 21] = 0, 100
    assert select_frontier_goal(GridMap(grid, 0.05, 0.0, 0.0), None) is not None


def test_small_clusters_are_ignored() -> None:
    grid = np.zeros((40, 40), np.int8)
    grid[20, 20] = -1  # four frontier cells around one unknown cell
    assert select_frontier_goal(GridMap(grid, 0.05, 0.0, 0.0), None) is None


def test_empty_map_has_no_frontiers() -> None:
    assert find_frontiers(GridMap(np.zeros((0, 0), np.int8), 0.05, 0.0, 0.0), None) == []
