"""Costmaps: what marks, what clears, what inflation costs, and that nothing malformed gets in."""

from __future__ import annotations

import math

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
    Scan,
)
from lupin_runtime.navigation.costmap.costs import OCCUPANCY_OF_COST
from lupin_runtime.navigation.costmap.kernels import squared_distances

HERE = BeamPoses(Pose2(), Pose2())


def scan(*ranges: float, angle_min: float = 0.0, step: float = 0.1, **more) -> Scan:
    return Scan(np.array(ranges, np.float32), angle_min, step, **more)


def local(*scans: Scan, poses: BeamPoses = HERE):
    costmap = LocalCostmap()
    costmap.roll_to(0.0, 0.0)
    for one in scans:
        costmap.observe(one, poses)
    return costmap.snapshot(Pose2())


def cost_at(costmap, x: float, y: float) -> int:
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
def test_inflation_costs_what_nav2s_formula_says(distance_m, cost):
    assert Inflation().cost(distance_m) == cost


@given(st.lists(st.floats(0.0, 1.0), min_size=2))
def test_inflation_never_rises_with_distance(distances):
    costs = [Inflation().cost(d) for d in sorted(distances)]
    assert costs == sorted(costs, reverse=True)


@settings(deadline=None)
@given(arrays(np.uint8, st.tuples(st.integers(1, 30), st.integers(1, 30)), elements=st.integers(0, 9)), st.integers(1, 12))
def test_distances_are_exact_up_to_their_reach(cells, reach):
    occupied = (cells == 9).astype(np.uint8)
    squares = squared_distances(occupied, reach).astype(int)
    if not occupied.any():
        assert (squares == (reach + 1) ** 2).all()
        return
    exact = np.rint(distance_transform_edt(occupied == 0) ** 2).astype(int)
    near = exact <= reach * reach
    assert (squares[near] == exact[near]).all()
    assert (squares[~near] > reach * reach).all()


@settings(deadline=None, max_examples=40)
@given(arrays(np.uint8, st.tuples(st.integers(1, 14), st.integers(1, 14)), elements=st.integers(0, 9)))
def test_distances_to_edges_are_those_of_squares(cells):
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
def test_a_reach_that_the_squares_cannot_hold_is_refused(reach, edges):
    with pytest.raises(ValueError, match="reach"):
        squared_distances(np.zeros((3, 3), np.uint8), reach, to_edges=edges)


def test_a_beam_marks_where_it_ends_and_nothing_on_its_way():
    costmap = local(scan(1.0))
    assert cost_at(costmap, 1.0, 0.0) == LETHAL
    assert cost_at(costmap, 0.5, 0.0) == FREE
    assert cost_at(costmap, 0.85, 0.0) == INSCRIBED
    assert costmap.distance_at(0.5, 0.0) == pytest.approx(0.5, abs=0.051)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 0.0, -1.0, 0.2, 2.6])
def test_beams_that_say_nothing_mark_nothing(bad):
    assert not (local(scan(bad)).cost == LETHAL).any()


def test_a_reading_beyond_the_lidars_own_range_says_nothing():
    assert not (local(scan(2.0, range_max_m=1.5)).cost == LETHAL).any()


@settings(deadline=None, max_examples=60)
@given(
    arrays(np.float32, st.integers(0, 50), elements=st.floats(width=32)),
    st.floats(allow_nan=True),
    st.floats(allow_nan=True),
)
def test_no_scan_however_broken_does_harm(ranges, angle_min, step):
    costmap = local(Scan(ranges, angle_min, step))
    rows, columns = np.nonzero(costmap.cost == LETHAL)
    assert (np.hypot((rows - 29.5) * 0.05, (columns - 29.5) * 0.05) < 2.6).all()


def test_a_mark_survives_one_beam_through_it_and_goes_after_several():
    marking, through = scan(1.0), scan(2.0)
    assert cost_at(local(marking, through), 1.0, 0.0) == LETHAL
    assert cost_at(local(marking, through, through, through), 1.0, 0.0) == FREE


def test_a_beam_does_not_clear_what_another_one_of_the_same_scan_hits():
    grazing = scan(1.0, 2.2, step=0.001)
    assert cost_at(local(grazing, grazing, grazing, grazing), 1.0, 0.0) == LETHAL


def test_readings_that_are_no_hits_do_not_clear_either():
    blind = scan(math.nan), scan(math.inf), scan(0.0)
    assert cost_at(local(scan(1.0), *blind, *blind), 1.0, 0.0) == LETHAL


def test_a_turn_during_the_scan_is_taken_out_of_it():
    beams = 64
    turning = BeamPoses(Pose2(0, 0, 0.0), Pose2(0, 0, 0.6))
    # A wall at y = 1 as a lidar sees it that turns by 0.6 rad from its first beam to its last.
    angles = 1.0 + 0.01 * np.arange(beams)
    seen = angles + 0.6 * np.arange(beams) / (beams - 1)
    wall = Scan((1.0 / np.sin(seen)).astype(np.float32), 1.0, 0.01)
    rows, _ = np.nonzero(local(wall, poses=turning).cost == LETHAL)
    assert set(rows - 30) <= {19, 20}
    rows, _ = np.nonzero(local(wall).cost == LETHAL)
    assert len(set(rows - 30)) > 3


def test_rolling_keeps_marks_where_they_are_in_the_world():
    costmap = LocalCostmap()
    costmap.roll_to(0.0, 0.0)
    costmap.observe(scan(1.0), HERE)
    costmap.roll_to(0.63, -0.41)
    moved = costmap.snapshot(Pose2(0.63, -0.41))
    assert cost_at(moved, 1.01, 0.0) == LETHAL
    assert (moved.cost == LETHAL).sum() == 1
    costmap.roll_to(9.0, 9.0)
    assert not (costmap.snapshot(Pose2(9.0, 9.0)).cost == LETHAL).any()


def test_what_the_robot_stands_on_is_no_obstacle():
    costmap = LocalCostmap()
    costmap.roll_to(0.0, 0.0)
    costmap.observe(scan(1.0), HERE)
    assert not (costmap.snapshot(Pose2(1.0, 0.0)).cost == LETHAL).any()


def grid(width: int = 40, height: int = 30, origin: float = 0.0, fill: int = 0) -> GridMap:
    return GridMap(np.full((height, width), fill, np.int8), 0.05, origin, origin)


def test_the_global_costmap_tracks_walls_and_the_unknown():
    cells = np.zeros((30, 40), np.int8)
    cells[10, 10], cells[20, :] = 100, -1
    costmap = GlobalCostmap()
    costmap.set_map(GridMap(cells, 0.05, 0.0, 0.0))
    snapshot = costmap.snapshot(None)
    assert snapshot.cost[10, 10] == LETHAL
    assert snapshot.cost[20, 30] == UNKNOWN
    assert snapshot.cost[10, 13] == INSCRIBED
    assert snapshot.cost[2, 35] == FREE


def test_marks_keep_their_places_when_the_map_grows_to_the_lower_left():
    costmap = GlobalCostmap()
    costmap.set_map(grid())
    costmap.observe(scan(0.5), BeamPoses(Pose2(1.0, 1.0), Pose2(1.0, 1.0)))
    before = costmap.snapshot(None)
    costmap.set_map(grid(80, 70, -1.0))
    after = costmap.snapshot(None)
    assert cost_at(before, 1.5, 1.0) == cost_at(after, 1.5, 1.0) == LETHAL
    assert (after.cost == LETHAL).sum() == 1


def test_marks_beside_the_map_fade_and_are_cleared_on_request():
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


def test_without_a_map_there_is_no_global_costmap():
    costmap = GlobalCostmap()
    assert not costmap.ready
    assert costmap.observe(scan(0.5), HERE) == 0
    with pytest.raises(LookupError):
        costmap.snapshot(None)


def test_published_costs_span_nav2s_scale():
    assert [int(OCCUPANCY_OF_COST[c]) for c in (FREE, 1, 252, INSCRIBED, LETHAL, UNKNOWN)] == [0, 1, 98, 99, 100, -1]
    assert (np.diff(OCCUPANCY_OF_COST[:255].astype(int)) >= 0).all()
