"""Costmaps: marking, clearing, inflation, and malformed scans."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.ndimage import distance_transform_edt

from lupin_runtime.geometry import Pose2
from lupin_runtime.gridmap import GridMap
from lupin_runtime.navigation.costmap import (
    FREE,
    INSCRIBED,
    LETHAL,
    UNKNOWN,
    BeamPoses,
    GlobalCostmap,
    Inflation,
    LocalCostmap,
    RangeScan,
)
from lupin_runtime.navigation.costmap.costs import OCCUPANCY_OF_COST
from lupin_runtime.navigation.costmap.kernels import squared_distances

if TYPE_CHECKING:
    from lupin_runtime.navigation.costmap.costmaps import Costmap

HERE = BeamPoses(Pose2(), Pose2())


def scan(*ranges: float, angle_min: float = 0.0, step: float = 0.1, **more: Any) -> RangeScan:
    return RangeScan(np.array(ranges, np.float32), angle_min, step, **more)


def local(*scans: RangeScan, poses: BeamPoses = HERE) -> Costmap:
    costmap = LocalCostmap()
    costmap.roll_to(0.0, 0.0)
    for one in scans:
        costmap.observe(one, poses)
    return costmap.snapshot(Pose2())


def cost_at(costmap: Costmap, x: float, y: float) -> int:
    return int(costmap.cost[costmap.cell_of(x, y)])


@pytest.mark.parametrize(
    ("distance_m", "cost"),
    [
        (0.0, LETHAL),
        (0.05, INSCRIBED),
        (0.22, INSCRIBED),
        (0.2236, int(252 * math.exp(-5 * 0.0036))),
        (0.25, 216),
        (0.26, FREE),
    ],
)
def test_inflation_follows_nav2s_formula(distance_m: float, cost: int) -> None:
    assert Inflation().cost(distance_m) == cost


@given(st.lists(st.floats(0.0, 1.0), min_size=2))
def test_inflation_never_rises_with_distance(distances: list[float]) -> None:
    costs = [Inflation().cost(d) for d in sorted(distances)]
    assert costs == sorted(costs, reverse=True)


@given(arrays(np.uint8, st.tuples(st.integers(1, 30), st.integers(1, 30)), elements=st.integers(0, 9)), st.integers(1, 12))
def test_distance_transform_is_exact_up_to_its_reach(cells: np.ndarray, reach: int) -> None:
    occupied = (cells == 9).astype(np.uint8)
    squares = squared_distances(occupied, reach).astype(int)
    if not occupied.any():
        assert (squares == (reach + 1) ** 2).all()
        return
    exact = np.rint(distance_transform_edt(occupied == 0) ** 2).astype(int)
    near = exact <= reach * reach
    assert (squares[near] == exact[near]).all()
    assert (squares[~near] > reach * reach).all()


@settings(max_examples=40)
@given(arrays(np.uint8, st.tuples(st.integers(1, 14), st.integers(1, 14)), elements=st.integers(0, 9)))
def test_edge_distances_equal_those_to_cell_squares(cells: np.ndarray) -> None:
    occupied = (cells == 9).astype(np.uint8)
    if not occupied.any():
        return
    rows, columns = np.nonzero(occupied)
    y, x = np.indices(occupied.shape)
    dy = np.maximum(np.abs(y[..., None] - rows) - 0.5, 0.0)
    dx = np.maximum(np.abs(x[..., None] - columns) - 0.5, 0.0)
    exact = np.rint(4 * (dx * dx + dy * dy).min(axis=-1)).astype(int)
    assert (squared_distances(occupied, 20, to_edges=True) == exact).all()


@pytest.mark.parametrize(("reach", "edges"), [(0, False), (181, False), (91, True)])
def test_reach_that_overflows_the_squares_is_refused(reach: int, edges: bool) -> None:
    with pytest.raises(ValueError, match="reach"):
        squared_distances(np.zeros((3, 3), np.uint8), reach, to_edges=edges)


def test_beam_marks_only_its_end() -> None:
    costmap = local(scan(1.0))
    assert cost_at(costmap, 1.0, 0.0) == LETHAL
    assert cost_at(costmap, 0.5, 0.0) == FREE
    assert cost_at(costmap, 0.85, 0.0) == INSCRIBED
    assert costmap.distance_at(0.5, 0.0) == pytest.approx(0.5, abs=0.051)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 0.0, -1.0, 0.2, 2.6])
def test_beams_without_a_hit_mark_nothing(bad: float) -> None:
    assert not (local(scan(bad)).cost == LETHAL).any()


def test_reading_beyond_the_lidar_range_is_ignored() -> None:
    assert not (local(scan(2.0, range_max_m=1.5)).cost == LETHAL).any()


@settings(max_examples=60)
@given(
    arrays(np.float32, st.integers(0, 50), elements=st.floats(width=32)),
    st.floats(allow_nan=True),
    st.floats(allow_nan=True),
)
def test_broken_scan_leaves_the_costmap_usable(ranges: np.ndarray, angle_min: float, step: float) -> None:
    costmap = local(RangeScan(ranges, angle_min, step))
    rows, columns = np.nonzero(costmap.cost == LETHAL)
    assert (np.hypot((rows - 29.5) * 0.05, (columns - 29.5) * 0.05) < 2.6).all()


def test_mark_survives_one_beam_through_it_but_not_several() -> None:
    marking, through = scan(1.0), scan(2.0)
    assert cost_at(local(marking, through), 1.0, 0.0) == LETHAL
    assert cost_at(local(marking, through, through, through), 1.0, 0.0) == FREE


def test_beam_keeps_marks_that_its_own_scan_hits() -> None:
    grazing = scan(1.0, 2.2, step=0.001)
    assert cost_at(local(grazing, grazing, grazing, grazing), 1.0, 0.0) == LETHAL


def test_invalid_readings_clear_no_marks() -> None:
    blind = scan(math.nan), scan(math.inf), scan(0.0)
    assert cost_at(local(scan(1.0), *blind, *blind), 1.0, 0.0) == LETHAL


def test_turn_during_a_scan_is_compensated() -> None:
    beams = 64
    turning = BeamPoses(Pose2(0, 0, 0.0), Pose2(0, 0, 0.6))
    # A wall at y = 1, seen by a lidar that turns by 0.6 rad from its first beam to its last.
    angles = 1.0 + 0.01 * np.arange(beams)
    seen = angles + 0.6 * np.arange(beams) / (beams - 1)
    wall = RangeScan((1.0 / np.sin(seen)).astype(np.float32), 1.0, 0.01)
    rows, _ = np.nonzero(local(wall, poses=turning).cost == LETHAL)
    assert set(rows - 30) <= {19, 20}
    rows, _ = np.nonzero(local(wall).cost == LETHAL)
    assert len(set(rows - 30)) > 3


def test_rolling_keeps_marks_in_place() -> None:
    costmap = LocalCostmap()
    costmap.roll_to(0.0, 0.0)
    costmap.observe(scan(1.0), HERE)
    costmap.roll_to(0.63, -0.41)
    moved = costmap.snapshot(Pose2(0.63, -0.41))
    assert cost_at(moved, 1.01, 0.0) == LETHAL
    assert (moved.cost == LETHAL).sum() == 1
    costmap.roll_to(9.0, 9.0)
    assert not (costmap.snapshot(Pose2(9.0, 9.0)).cost == LETHAL).any()


def test_cells_under_the_robot_are_no_obstacle() -> None:
    costmap = LocalCostmap()
    costmap.roll_to(0.0, 0.0)
    costmap.observe(scan(1.0), HERE)
    assert not (costmap.snapshot(Pose2(1.0, 0.0)).cost == LETHAL).any()


def grid(width: int = 40, height: int = 30, origin: float = 0.0, fill: int = 0) -> GridMap:
    return GridMap(np.full((height, width), fill, np.int8), 0.05, origin, origin)


def test_global_costmap_holds_walls_and_unknown_cells() -> None:
    cells = np.zeros((30, 40), np.int8)
    cells[10, 10], cells[20, :] = 100, -1
    costmap = GlobalCostmap()
    costmap.set_map(GridMap(cells, 0.05, 0.0, 0.0))
    snapshot = costmap.snapshot(None)
    assert snapshot.cost[10, 10] == LETHAL
    assert snapshot.cost[20, 30] == UNKNOWN
    assert snapshot.cost[10, 13] == INSCRIBED
    assert snapshot.cost[2, 35] == FREE


def test_marks_stay_in_place_when_the_map_grows_to_lower_left() -> None:
    costmap = GlobalCostmap()
    costmap.set_map(grid())
    costmap.observe(scan(0.5), BeamPoses(Pose2(1.0, 1.0), Pose2(1.0, 1.0)))
    before = costmap.snapshot(None)
    costmap.set_map(grid(80, 70, -1.0))
    after = costmap.snapshot(None)
    assert cost_at(before, 1.5, 1.0) == cost_at(after, 1.5, 1.0) == LETHAL
    assert (after.cost == LETHAL).sum() == 1


def test_marks_beside_the_map_fade_and_can_be_cleared() -> None:
    costmap = GlobalCostmap(memory_updates=5)
    costmap.set_map(grid())
    at = BeamPoses(Pose2(1.0, 1.0), Pose2(1.0, 1.0))
    costmap.observe(scan(0.5), at)
    for _ in range(4):
        costmap.observe(scan(math.nan), at)
    assert (costmap.snapshot(None).cost == LETHAL).any()
    costmap.observe(scan(math.nan), at)
    assert not (costmap.snapshot(None).cost == LETHAL).any()
    costmap.observe(scan(0.5), at)
    costmap.clear()
    assert not (costmap.snapshot(None).cost == LETHAL).any()


def test_global_costmap_without_a_map_is_not_ready() -> None:
    costmap = GlobalCostmap()
    assert not costmap.ready
    assert costmap.observe(scan(0.5), HERE) == 0
    with pytest.raises(LookupError):
        costmap.snapshot(None)


def test_published_costs_use_nav2s_scale() -> None:
    assert [int(OCCUPANCY_OF_COST[c]) for c in (FREE, 1, 252, INSCRIBED, LETHAL, UNKNOWN)] == [0, 1, 98, 99, 100, -1]
    assert (np.diff(OCCUPANCY_OF_COST[:255].astype(int)) >= 0).all()
