"""The occupancy grid: order of scans, growth, and moved scans."""

from __future__ import annotations

import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lupin_runtime.slam.occupancy import OccupancyMap, OccupancySettings
from lupin_runtime.slam.scan import Beams, ScanPoints, ScanReader
from tests.support.optional import present
from tests.support.slam_worlds import World, box

ANGLES = np.linspace(-math.pi, math.pi, 360, endpoint=False)
BEAMS = Beams(float(ANGLES[0]), float(ANGLES[1] - ANGLES[0]), 360)
ROOM = World(np.concatenate((box(0, 0, 6.01, 4.01), box(1.5, 0.5, 0.5, 0.5))))


def room_scan(pose: tuple[float, float, float]) -> ScanPoints:
    return ScanReader().read(BEAMS, ROOM.cast(np.asarray(pose, float), ANGLES, 12.0))


def drawn(poses: list[tuple[float, float, float]], order: list[int] | None = None) -> OccupancyMap:
    grid = OccupancyMap()
    for key in order if order is not None else range(len(poses)):
        grid.draw(int(key), room_scan(poses[key]), np.asarray(poses[key], float))
    return grid


POSES = [(0.0, 0.0, 0.0), (-1.0, 0.5, 1.0), (-1.5, -1.0, 2.0), (2.5, 1.5, -1.0), (2.4, -1.2, 3.0)]


def test_walls_are_occupied_room_free_and_beyond_unknown() -> None:
    grid = drawn(POSES).grid()
    for x, y in ((3.0, 0.0), (-3.0, 1.0), (0.0, 2.0), (1.25, 0.5)):
        assert grid is not None
        row, column = grid.cell_of(x, y)
        assert grid.cells[row - 1 : row + 2, column - 1 : column + 2].max() == 100
    for x, y in ((0.5, 0.0), (-2.0, 1.0), (2.6, -1.5)):
        assert present(grid).cells[present(grid).cell_of(x, y)] == 0
    assert present(grid).cells[present(grid).cell_of(1.5, 0.5)] == -1  # inside the box: never seen
    assert abs(present(grid).origin_x / 0.05 - round(present(grid).origin_x / 0.05)) < 1e-9


@settings(max_examples=20)
@given(order=st.permutations(range(len(POSES))))
def test_order_of_scans_does_not_matter(order: list[int]) -> None:
    a, b = drawn(POSES).grid(), drawn(POSES, order).grid()
    np.testing.assert_array_equal(present(a).cells, present(b).cells)
    assert (present(a).origin_x, present(a).origin_y) == (present(b).origin_x, present(b).origin_y)


@settings(max_examples=20)
@given(shifts=st.lists(st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(-3, 3)), min_size=5, max_size=5))
def test_moved_scans_leave_no_trace(shifts: list[tuple[float, float, float]]) -> None:
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
    # Shifts below the threshold are ignored; all others are exact.
    if all(abs(s[0]) + abs(s[1]) > 0.01 or abs(s[2]) > 0.002 for s in shifts):
        np.testing.assert_array_equal(present(a).cells, present(b).cells)


def test_redrawn_scan_replaces_the_old_one() -> None:
    grid = drawn(POSES)
    elsewhere = World(box(0, 0, 3.0, 2.0))
    small = ScanReader().read(BEAMS, elsewhere.cast(np.zeros(3), ANGLES, 12.0))
    for key, pose in enumerate(POSES):
        grid.draw(key, small, np.array([0.0, 0.0, pose[2] * 0.0]))
    cells = grid.grid()
    assert cells is not None
    assert cells.width * 0.05 == pytest.approx(3.0, abs=0.15)
    assert len(grid) == len(POSES)


def test_removed_wall_disappears_when_seen_again() -> None:
    grid = drawn(POSES)
    empty = World(box(0, 0, 6.01, 4.01))
    for key, pose in enumerate(POSES):
        grid.draw(key, ScanReader().read(BEAMS, empty.cast(np.asarray(pose), ANGLES, 12.0)), np.asarray(pose))
    assert present(grid.grid()).cells[present(grid.grid()).cell_of(1.5, 0.5)] == 0


def test_empty_map_has_no_grid() -> None:
    assert OccupancyMap().grid() is None


@pytest.mark.parametrize("x", [500.0, 1e9, 1e300])
def test_scan_far_away_is_left_out_and_takes_no_memory(x: float) -> None:
    grid = drawn(POSES)
    before = present(grid.grid())
    tracemalloc.start()
    grid.draw(len(POSES), room_scan(POSES[0]), np.array([x, x, 0.0]))
    peak_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert grid.left_out == 1 and peak_bytes < 10_000_000
    np.testing.assert_array_equal(present(grid.grid()).cells, before.cells)
    grid.move({len(POSES): np.zeros(3)})  # what was left out is not moved
    assert grid.waiting == 0
