"""Paths to drive: free, inside the map, with clearance on both sides, or a reason if there is none."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lupin_runtime.gridmap import GridMap
from lupin_runtime.navigation.costmap import UNKNOWN, GlobalCostmap
from lupin_runtime.navigation.planning import NoPath, PlanFailure, PlannerParameters, plan
from lupin_runtime.navigation.planning.paths import arc_lengths

if TYPE_CHECKING:
    from lupin_runtime.navigation.costmap.costmaps import Costmap

RADIUS_M = PlannerParameters().robot_radius_m


def costmap_from_cells(cells: np.ndarray, origin: float = 0.0) -> Costmap:
    costmap = GlobalCostmap()
    costmap.set_map(GridMap(cells.astype(np.int8), 0.05, origin, origin))
    return costmap.snapshot(None)


def room(height: int = 80, width: int = 120) -> np.ndarray:
    cells = np.zeros((height, width), np.int8)
    cells[[0, -1], :] = cells[:, [0, -1]] = 100
    return cells


def clearances(costmap: Costmap, points: np.ndarray) -> np.ndarray:
    return np.array([costmap.distance_at(x, y) for x, y in points])


@settings(max_examples=60)
@given(st.integers(0, 10**6), st.integers(0, 30))
def test_path_keeps_the_radius_from_every_wall(seed: int, boxes: int) -> None:
    random = np.random.default_rng(seed)
    cells = room()
    for _ in range(boxes):
        y, x = random.integers(1, 75), random.integers(1, 110)
        cells[y : y + random.integers(1, 12), x : x + random.integers(1, 25)] = 100
    cells[30:50, 10:20] = cells[30:50, 100:110] = 0
    costmap = costmap_from_cells(cells)
    start, goal = (0.75, 2.0), (5.25, 2.0)
    if costmap.distance_at(*start) <= RADIUS_M:
        return
    try:
        found = plan(costmap, start, goal)
    except NoPath as refusal:
        assert refusal.failure in (PlanFailure.NO_VALID_PATH, PlanFailure.GOAL_OCCUPIED)
        return
    # A point of a free cell may be half a cell's diagonal nearer than its center; the guarantee is for cells.
    assert (clearances(costmap, found.points) > RADIUS_M).all()
    assert tuple(found.points[0]) == pytest.approx(start)
    assert math.dist(found.goal, goal) <= PlannerParameters().tolerance
    steps = np.diff(arc_lengths(found.points))
    assert steps.max() < 0.1


def test_path_runs_in_the_middle_of_an_aisle() -> None:
    cells = room(60, 200)
    cells[:22, 30:170] = cells[40:, 30:170] = 100  # an aisle of 18 cells, 0.9 m, around y = 1.55
    found = plan(costmap_from_cells(cells), (0.75, 2.2), (9.25, 0.9))
    inside = found.points[(found.points[:, 0] > 3.0) & (found.points[:, 0] < 7.0)]
    assert np.abs(inside[:, 1] - 1.55).max() < 0.08


def test_path_prefers_wide_aisles_but_takes_an_only_gap() -> None:
    cells = room(120, 120)
    cells[:, 60:64] = 100
    cells[50:60, 60:64] = 0  # 0.5 m: the robot fits with 3 cm to spare
    found = plan(costmap_from_cells(cells), (1.0, 2.75), (5.0, 2.75))
    assert np.abs(found.points[:, 1] - 2.75).max() < 0.2
    cells[75:105, 60:64] = 0  # 1.5 m, a little off the straight line
    found = plan(costmap_from_cells(cells), (1.0, 2.75), (5.0, 2.75))
    assert found.points[:, 1].max() > 3.8


def test_goal_too_near_to_a_wall_moves_to_the_nearest_free_pose() -> None:
    cells = room()
    found = plan(costmap_from_cells(cells), (1.0, 2.0), (5.85, 2.0))
    assert found.goal[0] == pytest.approx(6.0 - 0.05 - 0.25, abs=0.06)
    assert found.goal[1] == pytest.approx(2.0, abs=0.05)


def test_goal_deep_in_a_bench_has_no_path() -> None:
    cells = room()
    cells[20:60, 60:100] = 100
    with pytest.raises(NoPath, match="from an obstacle") as refusal:
        plan(costmap_from_cells(cells), (1.0, 2.0), (4.0, 2.0))
    assert refusal.value.failure is PlanFailure.GOAL_OCCUPIED


def test_goal_behind_a_closed_wall_has_no_path() -> None:
    cells = room()
    cells[:, 60] = 100
    with pytest.raises(NoPath, match=r"no path of 0\.44 m width") as refusal:
        plan(costmap_from_cells(cells), (1.0, 2.0), (5.0, 2.0))
    assert refusal.value.failure is PlanFailure.NO_VALID_PATH


@pytest.mark.parametrize(
    ("start", "goal", "failure"),
    [
        ((9.0, 1.0), (1.0, 1.0), PlanFailure.START_OUTSIDE_MAP),
        ((1.0, 1.0), (1.0, -2.0), PlanFailure.GOAL_OUTSIDE_MAP),
        ((1.0, 1.0), (math.nan, 1.0), PlanFailure.GOAL_OUTSIDE_MAP),
        ((math.inf, 1.0), (1.0, 1.0), PlanFailure.START_OUTSIDE_MAP),
    ],
)
def test_start_or_goal_outside_the_map_is_named(start: tuple[float, float], goal: tuple[float, float], failure: Any) -> None:
    with pytest.raises(NoPath, match="outside the map") as refusal:
        plan(costmap_from_cells(room()), start, goal)
    assert refusal.value.failure is failure


def test_unknown_space_is_entered_only_if_allowed() -> None:
    cells = room()
    cells[1:-1, 50:70] = -1
    costmap = costmap_from_cells(cells)
    assert (costmap.cost == UNKNOWN).any()
    assert plan(costmap, (1.0, 2.0), (5.0, 2.0)).length_m == pytest.approx(4.0, rel=0.02)
    with pytest.raises(NoPath):
        plan(costmap, (1.0, 2.0), (5.0, 2.0), PlannerParameters(allow_unknown=False))


def test_robot_too_near_to_a_wall_finds_a_path_out() -> None:
    costmap = costmap_from_cells(room())
    start = (0.15, 2.0)
    assert costmap.distance_at(*start) < RADIUS_M
    found = plan(costmap, start, (5.0, 2.0))
    room_to_wall = clearances(costmap, found.points)
    assert (np.diff(room_to_wall[: int(0.3 / 0.05)]) >= 0.0).all()
    assert (room_to_wall[int(0.4 / 0.05) :] > RADIUS_M).all()


def test_robot_enclosed_by_walls_has_no_path() -> None:
    cells = room()
    cells[30:50, 30:50] = 100
    cells[39:41, 39:41] = 0
    with pytest.raises(NoPath) as refusal:
        plan(costmap_from_cells(cells), (2.0, 2.0), (5.0, 2.0))
    assert refusal.value.failure in (PlanFailure.START_OCCUPIED, PlanFailure.NO_VALID_PATH)


def test_start_and_goal_in_one_cell_give_two_points() -> None:
    found = plan(costmap_from_cells(room()), (2.01, 2.01), (2.03, 2.04))
    assert found.length_m < 0.1
    assert found.goal == pytest.approx((2.03, 2.04))


def test_large_map_on_a_coarser_grid_gives_an_equal_path() -> None:
    cells = room(1100, 1100)
    cells[1:900, 300:310] = cells[200:-1, 600:610] = 100
    large = costmap_from_cells(cells)
    assert large.cost.size > 1_000_000
    found = plan(large, (5.0, 5.0), (50.0, 50.0))
    assert (clearances(large, found.points) > RADIUS_M).all()
    corners = [(5.0, 5.0), (15.25, 45.3), (30.25, 9.7), (50.0, 50.0)]
    straight = sum(math.dist(a, b) for a, b in pairwise(corners))
    assert straight < found.length_m < 1.03 * straight
