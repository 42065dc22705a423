"""The coarse map of a run's state: its size is bounded, walls stay, and damaged grids give none."""

from __future__ import annotations

import math

import numpy as np
import pytest
from nav_msgs.msg import OccupancyGrid

from lupin_runtime.ros.plane_messages import grid_message
from lupin_runtime.stack.coarse_map import MAX_MAP_COLUMNS, MAX_MAP_ROWS, coarse_map


def grid(cells: np.ndarray, resolution_m: float = 0.05) -> OccupancyGrid:
    return grid_message(cells.astype(np.int8), resolution_m, (-2.0, 1.0), "map", 0)


def test_unknown_border_is_left_out() -> None:
    cells = np.full((6, 8), -1)
    cells[2:4, 3:6] = 0
    cells[3, 4] = 100
    found = coarse_map(grid(cells))
    assert found is not None
    assert found["rows"] == ["...", ".#."]
    assert (found["x"], found["y"], found["cell_m"]) == (-1.85, 1.1, 0.05)
    assert found["free_m2"] == round(5 * 0.05**2, 1)


def test_thin_walls_of_a_large_map_stay() -> None:
    cells = np.zeros((700, 1300))
    cells[:, 640] = 100
    cells[300:, 641:] = -1
    found = coarse_map(grid(cells))
    assert found is not None
    assert len(found["rows"]) <= MAX_MAP_ROWS and len(found["rows"][0]) <= MAX_MAP_COLUMNS
    assert all(row.count("#") == 1 for row in found["rows"])
    assert found["rows"][-1].endswith(" ") and found["rows"][0].endswith(".")
    assert found["cell_m"] * len(found["rows"][0]) == pytest.approx(1300 * 0.05, rel=0.02)


@pytest.mark.parametrize("damage", ["unknown", "short", "resolution", "nan", "origin", "empty"])
def test_damaged_or_unknown_map_is_none(damage: str) -> None:
    message = grid(np.full((4, 4), -1) if damage == "unknown" else np.zeros((4, 4)))
    if damage == "short":
        message.data = message.data[:-1]
    if damage == "resolution":
        message.info.resolution = 0.0
    if damage == "nan":
        message.info.resolution = math.nan
    if damage == "origin":
        message.info.origin.position.x = math.inf
    if damage == "empty":
        message.data, message.info.width = message.data[:0], 0
    assert coarse_map(message) is None
