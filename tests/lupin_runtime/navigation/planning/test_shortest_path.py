"""The shortest path: against an independent exact reference, and on simple grids."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.ndimage import label
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from lupin_runtime.gridmap import GridMap
from lupin_runtime.navigation.planning import NoPath, PlanFailure
from lupin_runtime.navigation.planning.shortest_path import find_shortest_path
from tests.support.optional import present
from tests.support.tangent_graph import keeps_clear, random_boxes, shortest_length

if TYPE_CHECKING:
    from lupin_runtime.navigation.planning.paths import Plan


def empty(height: int = 100, width: int = 100) -> np.ndarray:
    return np.zeros((height, width), np.int8)


def through(
    cells: np.ndarray, start: tuple[float, float], goal: tuple[float, float], radius_m: float = 0.0, **more: Any
) -> Plan | None:
    return find_shortest_path(GridMap(cells, 0.05, 0.0, 0.0), start, goal, radius_m, **more)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(
    ("cells", "count", "sides", "radius_m"),
    [(240, 26, (8, 40), 0.22), (160, 40, (3, 12), 0.115), (200, 18, (4, 30), 0.42)],
    ids=["furniture", "clutter", "wide robot"],
)
def test_path_is_within_one_percent_and_keeps_its_distance(
    cells: int, count: int, sides: tuple[int, int], radius_m: float, seed: int
) -> None:
    grid, boxes = random_boxes(cells, count, sides, seed)
    size = cells * 0.05
    start, goal = (0.513, 0.527), (size - 0.52, size - 0.513)
    exact = shortest_length(boxes, start, goal, radius_m, size, chords=3)
    try:
        found = find_shortest_path(grid, start, goal, radius_m)
    except NoPath:
        assert exact == math.inf
        return
    assert 0.999 * exact <= found.length_m <= 1.01 * exact
    points = found.points
    # The documented accuracy: a fiftieth of a cell.
    assert keeps_clear(points[:-1], points[1:], boxes, radius_m - 0.0011).all()
    assert points[0] == pytest.approx(start)
    assert points[-1] == pytest.approx(goal)


def test_path_around_one_bench_is_two_tangents_and_two_arcs() -> None:
    cells = empty(200, 200)
    cells[80:120, 60:140] = 100  # x 3 .. 7, y 4 .. 6
    radius = 0.3
    found = through(cells, (1.0, 5.0), (9.0, 5.0), radius)
    reach = math.hypot(2.0, 1.0)
    tangent = math.sqrt(reach * reach - radius * radius)
    # The turn at a corner: the angle up to it, less what the tangent gains, back to level.
    turn = math.atan2(1.0, 2.0) + math.asin(radius / reach)
    assert found is not None
    assert found.length_m == pytest.approx(2 * tangent + 2 * radius * turn + 4.0, rel=1e-3)


def test_path_in_the_open_is_the_straight_line() -> None:
    found = through(empty(), (0.513, 0.527), (4.31, 2.77), 0.3)
    assert found is not None
    assert len(found.points) == 2
    assert found.length_m == pytest.approx(math.dist((0.513, 0.527), (4.31, 2.77)))


def test_thin_walls_block_and_narrow_doors_pass() -> None:
    cells = empty()
    cells[:, 50] = 100
    with pytest.raises(NoPath, match="no path"):
        through(cells, (1.0, 2.5), (4.0, 2.5))
    cells[71, 50] = 0
    found = through(cells, (1.0, 2.5), (4.0, 2.5))
    assert found is not None
    at_door = np.interp(2.525, found.points[:, 0], found.points[:, 1])
    assert 3.55 <= at_door <= 3.6


def test_diagonal_cells_leave_no_gap() -> None:
    cells = empty(40, 40)
    cells[np.arange(40), np.arange(40)] = 100
    with pytest.raises(NoPath):
        through(cells, (1.5, 0.5), (0.5, 1.5))


def test_gap_passes_only_discs_that_fit() -> None:
    cells = empty()
    cells[:40, 50] = cells[51:, 50] = 100  # 11 cells: 0.55 m
    assert present(through(cells, (1.0, 2.3), (4.0, 2.3), 0.25)).length_m == pytest.approx(3.0, rel=0.01)
    with pytest.raises(NoPath) as refusal:
        through(cells, (1.0, 2.3), (4.0, 2.3), 0.3)
    assert refusal.value.failure is PlanFailure.NO_VALID_PATH


def _geodesics(cells: np.ndarray, start: tuple[int, int]) -> np.ndarray:
    """Return lengths in cells from a cell over the 8-neighborhood without cutting corners."""
    height, width = cells.shape
    free = cells == 0
    rows, columns, weights = [], [], []
    index = np.arange(height * width).reshape(height, width)
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = (slice(0, height - dy), slice(max(0, -dx), width - max(0, dx)))
        b = (slice(dy, height), slice(max(0, dx), width + min(0, dx)))
        ok = free[a] & free[b]
        if dx and dy:
            ok &= free[a[0], b[1]] & free[b[0], a[1]]
        rows.append(index[a][ok])
        columns.append(index[b][ok])
        weights.append(np.full(int(ok.sum()), math.hypot(dx, dy)))
    graph = csr_matrix(
        (np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns))), shape=(index.size, index.size)
    )
    result: np.ndarray = dijkstra(graph, directed=False, indices=index[start]).reshape(height, width)
    return result


@settings(max_examples=200)
@given(
    arrays(np.int8, st.tuples(st.integers(2, 40), st.integers(2, 40)), elements=st.sampled_from([0, 0, 0, 0, 100])),
    st.data(),
)
def test_path_exists_exactly_if_cells_connect(cells: np.ndarray, data: Any) -> None:
    height, width = cells.shape
    start = data.draw(st.tuples(st.integers(0, height - 1), st.integers(0, width - 1)))
    goal = data.draw(st.tuples(st.integers(0, height - 1), st.integers(0, width - 1)))
    cells[start] = cells[goal] = 0
    regions, _ = label(cells == 0)
    ends = [((c + 0.5) * 0.05, (r + 0.5) * 0.05) for r, c in (start, goal)]
    if regions[start] != regions[goal]:
        with pytest.raises(NoPath):
            through(cells, *ends)  # type: ignore[arg-type]
        return
    found = through(cells, *ends)  # type: ignore[arg-type]
    grid_length = _geodesics(cells, start)[goal] * 0.05
    assert found is not None
    assert math.dist(*ends) - 1e-9 <= found.length_m <= 1.001 * grid_length + 1e-9
    # No point of the path lies inside an occupied cell.
    for a, b in zip(found.points, found.points[1:]):
        along = np.linspace(a, b, 2 + int(math.dist(a, b) / 0.004)) / 0.05
        inside = np.abs(along - np.round(along)).min(axis=1) > 1e-6
        hit = along[inside].astype(int)
        assert not cells[hit[:, 1], hit[:, 0]].any()


@pytest.mark.parametrize("seed", range(4))
def test_maze_of_thin_walls_is_solved(seed: int) -> None:
    random = np.random.default_rng(seed)
    cells = empty(161, 161)
    cells[::8, :] = cells[:, ::8] = 100
    # Open a door from every room to a neighbor of a random spanning tree: exactly one path leads to each room.
    seen, stack = {(0, 0)}, [(0, 0)]
    while stack:
        r, c = stack[-1]
        others = [(r + dr, c + dc) for dr, dc in ((0, 1), (1, 0), (0, -1), (-1, 0))]
        others = [o for o in others if o not in seen and 0 <= o[0] < 20 and 0 <= o[1] < 20]
        if not others:
            stack.pop()
            continue
        nr, nc = others[random.integers(len(others))]
        cells[4 + 4 * (r + nr) - 1 : 4 + 4 * (r + nr) + 2, 4 + 4 * (c + nc) - 1 : 4 + 4 * (c + nc) + 2] = 0
        seen.add((nr, nc))
        stack.append((nr, nc))
    found = through(cells, (0.225, 0.225), (7.825, 7.825))
    grid_length = _geodesics(cells, (4, 4))[156, 156] * 0.05
    assert found is not None
    assert 0.85 * grid_length < found.length_m < grid_length


def test_unknown_cells_are_walls_only_when_asked() -> None:
    cells = empty()
    cells[:, 40:60] = -1
    assert present(through(cells, (1.0, 2.5), (4.0, 2.5))).length_m == pytest.approx(3.0)
    with pytest.raises(NoPath):
        through(cells, (1.0, 2.5), (4.0, 2.5), allow_unknown=False)


def test_tolerance_ends_the_path_nearest_to_a_blocked_goal() -> None:
    cells = empty()
    cells[40:60, 60:80] = 100
    with pytest.raises(NoPath) as refusal:
        through(cells, (1.0, 2.5), (3.1, 2.5), 0.1)
    assert refusal.value.failure is PlanFailure.GOAL_OCCUPIED
    found = through(cells, (1.0, 2.5), (3.1, 2.5), 0.1, tolerance_m=0.5)
    assert found is not None
    assert found.goal[0] == pytest.approx(3.0 - 0.1, abs=0.05)


def test_start_within_the_radius_of_a_wall_is_refused() -> None:
    cells = empty()
    cells[:, 0] = 100
    with pytest.raises(NoPath) as refusal:
        through(cells, (0.15, 2.5), (4.0, 2.5), 0.22)
    assert refusal.value.failure is PlanFailure.START_OCCUPIED


@pytest.mark.parametrize("radius_m", [-0.1, math.nan, 5.0])
def test_invalid_radius_is_refused(radius_m: float) -> None:
    with pytest.raises(ValueError, match="radius"):
        through(empty(), (1.0, 1.0), (2.0, 2.0), radius_m)


def test_block_cells_without_line_of_sight_join_around_the_wall() -> None:
    cells = empty(8, 8)
    cells[1:, 4] = 100
    found = through(cells, (0.125, 0.375), (0.325, 0.375))
    assert found is not None
    assert found.length_m == pytest.approx(2 * math.hypot(0.075, 0.325) + 0.05, rel=1e-3)
