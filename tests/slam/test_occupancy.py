"""The occupancy grid: counters that commute, growth without loss, moves that leave no trace."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.slam_worlds import World, box
from lupin_runtime.slam.occupancy import OccupancyMap, OccupancySettings
from lupin_runtime.slam.scan import Beams, Scan, ScanReader

ANGLES = np.linspace(-math.pi, math.pi, 360, endpoint=False)
BEAMS = Beams(float(ANGLES[0]), float(ANGLES[1] - ANGLES[0]), 360)
ROOM = World(np.concatenate((box(0, 0, 6.01, 4.01), box(1.5, 0.5, 0.5, 0.5))))


def room_scan(pose) -> Scan:
    return ScanReader().read(BEAMS, ROOM.cast(np.asarray(pose, float), ANGLES, 12.0))


def drawn(poses, order=None) -> OccupancyMap:
    grid = OccupancyMap()
    for key in order if order is not None else range(len(poses)):
        grid.draw(int(key), room_scan(poses[key]), np.asarray(poses[key], float))
    return grid


POSES = [(0.0, 0.0, 0.0), (-1.0, 0.5, 1.0), (-1.5, -1.0, 2.0), (2.5, 1.5, -1.0), (2.4, -1.2, 3.0)]


def test_walls_are_occupied_the_room_is_free_and_beyond_is_unknown():
    grid = drawn(POSES).grid()
    for x, y in ((3.0, 0.0), (-3.0, 1.0), (0.0, 2.0), (1.25, 0.5)):
        row, column = grid.cell_of(x, y)
        assert grid.cells[row - 1 : row + 2, column - 1 : column + 2].max() == 100
    for x, y in ((0.5, 0.0), (-2.0, 1.0), (2.6, -1.5)):
        assert grid.cells[grid.cell_of(x, y)] == 0
    assert grid.cells[grid.cell_of(1.5, 0.5)] == -1  # inside the box: never seen
    assert abs(grid.origin_x / 0.05 - round(grid.origin_x / 0.05)) < 1e-9


@settings(max_examples=20, deadline=None)
@given(order=st.permutations(range(len(POSES))))
def test_the_order_of_scans_does_not_matter(order):
    a, b = drawn(POSES).grid(), drawn(POSES, order).grid()
    np.testing.assert_array_equal(a.cells, b.cells)
    assert (a.origin_x, a.origin_y) == (b.origin_x, b.origin_y)


@settings(max_examples=20, deadline=None)
@given(shifts=st.lists(st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(-3, 3)), min_size=5, max_size=5))
def test_moved_scans_leave_no_trace_where_they_were(shifts):
    there = [tuple(np.add(pose, shift)) for pose, shift in zip(POSES, shifts)]
    moved = drawn(POSES)
    moved.move({key: np.array(pose) for key, pose in enumerate(there)})
    rounds = 0
    while moved.waiting:
        moved.work(2)
        rounds += 1
    assert rounds <= 3
    fresh = OccupancyMap(OccupancySettings())
    for key, pose in enumerate(there):
        fresh.draw(key, room_scan(POSES[key]), np.array(pose))
    a, b = moved.grid(), fresh.grid()
    # Shifts below the threshold are not worth a move; all others are exact.
    if all(abs(s[0]) + abs(s[1]) > 0.01 or abs(s[2]) > 0.002 for s in shifts):
        np.testing.assert_array_equal(a.cells, b.cells)


def test_a_scan_drawn_again_replaces_the_old_one():
    grid = drawn(POSES)
    elsewhere = World(box(0, 0, 3.0, 2.0))
    small = ScanReader().read(BEAMS, elsewhere.cast(np.zeros(3), ANGLES, 12.0))
    for key, pose in enumerate(POSES):
        grid.draw(key, small, np.array([0.0, 0.0, pose[2] * 0.0]))
    cells = grid.grid()
    assert cells.width * 0.05 == pytest.approx(3.0, abs=0.15)
    assert len(grid) == len(POSES)


def test_a_wall_that_was_taken_away_disappears_as_its_keyframes_are_seen_again():
    grid = drawn(POSES)
    empty = World(box(0, 0, 6.01, 4.01))
    for key, pose in enumerate(POSES):
        grid.draw(key, ScanReader().read(BEAMS, empty.cast(np.asarray(pose), ANGLES, 12.0)), np.asarray(pose))
    assert grid.grid().cells[grid.grid().cell_of(1.5, 0.5)] == 0


def test_nothing_drawn_is_no_map():
    assert OccupancyMap().grid() is None
