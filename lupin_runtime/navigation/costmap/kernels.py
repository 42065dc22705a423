"""The C kernels of this folder with checked argument types."""

from __future__ import annotations

from ctypes import c_double, c_int64, c_uint8
from pathlib import Path

import numpy as np
from numpy.ctypeslib import ndpointer
from numpy.typing import NDArray

from lupin_runtime.native import load_kernels

_U8 = ndpointer(np.uint8, 2, flags="C_CONTIGUOUS")
_U16 = ndpointer(np.uint16, 2, flags="C_CONTIGUOUS")
_F32_GRID = ndpointer(np.float32, 2, flags="C_CONTIGUOUS")
_F32 = ndpointer(np.float32, 1, flags="C_CONTIGUOUS")
_F64 = ndpointer(np.float64, 1, flags="C_CONTIGUOUS")
_TABLE = ndpointer(np.uint8, 1, flags="C_CONTIGUOUS")

_library = load_kernels(Path(__file__).parent)

trace_scan = _library.trace_scan
trace_scan.restype = c_int64
trace_scan.argtypes = [
    *(_U8, _U8, c_int64, c_int64, _F64),
    *(_F32, c_int64, c_double, c_double, _F64, _F64, c_uint8, c_uint8),
]

_squared_distances = _library.squared_distances
_squared_distances.restype = c_int64
_squared_distances.argtypes = [_U8, c_int64, c_int64, c_int64, c_int64, _U16]

look_up_costs = _library.look_up_costs
look_up_costs.restype = None
look_up_costs.argtypes = [_U8, _U16, c_int64, _TABLE, _F32, _U8, _F32_GRID]

# The squares are 16 bits wide.
MAX_REACH_CELLS = 180
MAX_EDGE_REACH_CELLS = 90


def squared_distances(set_cells: NDArray[np.uint8], reach_cells: int, to_edges: bool = False) -> NDArray[np.uint16]:
    """Return the squared distance of each cell's center to the nearest non-zero cell of `set_cells` (height, width).

    It is measured to that cell's center in cells, or with `to_edges` to its square in half cells. It is exact up to the reach;
    larger distances read (reach + 1)^2, or (2 reach + 1)^2. Raises ValueError if the reach exceeds 16 bits, and MemoryError.
    """
    limit = MAX_EDGE_REACH_CELLS if to_edges else MAX_REACH_CELLS
    if not 1 <= reach_cells <= limit:
        raise ValueError(f"a reach of {reach_cells} cells is outside 1..{limit}")
    height, width = set_cells.shape
    out = np.empty((height, width), np.uint16)
    if _squared_distances(set_cells, height, width, reach_cells, int(to_edges), out) != 0:
        raise MemoryError(f"out of memory for the distances of {height} x {width} cells")
    return out
