"""The C kernels of this folder with checked argument types."""

from __future__ import annotations

from ctypes import c_double, c_int64
from pathlib import Path

import numpy as np
from numpy.ctypeslib import ndpointer
from numpy.typing import NDArray

from lupin_runtime.native import load_kernels

_GRID = ndpointer(np.float32, 2, flags="C_CONTIGUOUS")
_CELLS = ndpointer(np.uint8, 2, flags="C_CONTIGUOUS")
_F64 = ndpointer(np.float64, 1, flags="C_CONTIGUOUS")
_POINTS = ndpointer(np.float64, 2, flags="C_CONTIGUOUS")

_library = load_kernels(Path(__file__).parent)

_march = _library.march
_march.restype = c_int64
_march.argtypes = [_GRID, c_int64, c_int64, c_int64, c_int64, c_double, _GRID]

_descend = _library.descend
_descend.restype = c_int64
_descend.argtypes = [_GRID, c_int64, c_int64, _F64, c_int64, c_int64, _POINTS, c_int64]

_shortest_path = _library.shortest_path
_shortest_path.restype = c_int64
_shortest_path.argtypes = [_CELLS, _CELLS, c_int64, c_int64, _F64, c_double, c_double, _POINTS, c_int64]

_NO_PATH, _OVER_CAPACITY = -2, -3

Cell = tuple[int, int]


def march(slowness: NDArray[np.float32], start: Cell, goal: Cell | None) -> tuple[NDArray[np.float32], bool]:
    """Return the arrival times (height, width) of a front from the cell `start`, and whether it reached `goal`.

    `slowness`: 0 blocked, else at least 1. Times are in cells; infinity for cells that the front did not reach.
    """
    height, width = slowness.shape
    times = np.empty((height, width), np.float32)
    slowest = float(slowness.max(initial=1.0))
    target = -1 if goal is None else goal[0] * width + goal[1]
    reached = _march(slowness, height, width, start[0] * width + start[1], target, slowest, times)
    if reached < 0:
        raise MemoryError(f"out of memory while planning over {height} x {width} cells")
    return times, bool(reached)


def descend(times: NDArray[np.float32], origin: tuple[float, float], to: Cell) -> NDArray[np.float64]:
    """Descend `times`: points (n, 2) as (x, y) in cells from `origin` (centers at .5) to the cell `to`, both included.

    Raises ArithmeticError if the times do not lead there.
    """
    height, width = times.shape
    capacity = 8 * (height + width) + times.size // 2
    points = np.empty((capacity, 2))
    for smooth in (1, 0):
        count = _descend(times, height, width, np.array(origin), to[0] * width + to[1], smooth, points, capacity)
        if count > 0:
            return np.vstack((points[:count], [to[1] + 0.5, to[0] + 0.5]))
    raise ArithmeticError(f"the arrival times do not lead from {origin} to cell {to}")


def shortest_path(
    blocked: NDArray[np.uint8],
    occupied: NDArray[np.uint8],
    start: tuple[float, float],
    goal: tuple[float, float],
    tolerance: float,
    radius: float,
) -> NDArray[np.float64] | None:
    """Return the shortest path (n, 2) as (x, y) in cells through cells that are not `blocked`, or None.

    It keeps `radius` cells from the squares of `occupied` cells. The start's cell must be free, start and goal in the grid.
    """
    height, width = blocked.shape
    ends = np.array([*start, *goal])
    capacity = 4096
    while True:
        path = np.empty((capacity, 2))
        count = _shortest_path(blocked, occupied, height, width, ends.copy(), tolerance, radius, path, capacity)
        if count == _OVER_CAPACITY:
            capacity *= 4
            continue
        if count == _NO_PATH:
            return None
        if count < 0:
            raise MemoryError(f"out of memory while planning over {height} x {width} cells")
        return path[:count].copy()
