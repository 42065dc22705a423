"""A small picture of the occupancy grid, for views of a run in a terminal."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.gridmap import OCCUPIED, UNKNOWN

MAX_MAP_COLUMNS, MAX_MAP_ROWS = 120, 90
MAX_MAP_CELLS = 25_000_000  # 250 m x 250 m at 5 cm; a larger map is not drawn
FREE_CELL, OCCUPIED_CELL, UNKNOWN_CELL = ".", "#", " "


def coarse_map(message: Any) -> dict[str, Any] | None:
    """Return an OccupancyGrid reduced to at most MAX_MAP_COLUMNS x MAX_MAP_ROWS cells; None if it shows nothing or is damaged.

    Unknown borders are left out. A coarse cell is occupied if any of its cells is, else free if any of them is.
    """
    info = message.info
    width, height, data = info.width, info.height, message.data
    usable = math.isfinite(info.resolution) and info.resolution > 0 and 0 < width * height == len(data) <= MAX_MAP_CELLS
    origin = info.origin.position
    if not usable or not (math.isfinite(origin.x) and math.isfinite(origin.y)):
        return None
    cells = np.frombuffer(memoryview(data), np.int8).reshape(height, width)
    known = cells != UNKNOWN
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if not len(rows):
        return None
    top, left = int(rows[0]), int(columns[0])
    cells = cells[top : rows[-1] + 1, left : columns[-1] + 1]
    factor = max(1, math.ceil(cells.shape[1] / MAX_MAP_COLUMNS), math.ceil(cells.shape[0] / MAX_MAP_ROWS))
    occupied, free = (
        _any_of_blocks(cells > OCCUPIED // 2, factor),
        _any_of_blocks((cells >= 0) & (cells <= OCCUPIED // 2), factor),
    )
    letters = np.where(occupied, OCCUPIED_CELL, np.where(free, FREE_CELL, UNKNOWN_CELL))
    return {
        "x": round(origin.x + left * info.resolution, 3),
        "y": round(origin.y + top * info.resolution, 3),
        "cell_m": round(info.resolution * factor, 6),
        "rows": ["".join(row) for row in letters],
        "free_m2": round(float(np.count_nonzero(free)) * info.resolution**2, 1),
    }


def _any_of_blocks(mask: NDArray[np.bool_], factor: int) -> NDArray[np.bool_]:
    """Return for each block of factor x factor cells whether any is set."""
    height, width = (math.ceil(size / factor) for size in mask.shape)
    padded = np.zeros((height * factor, width * factor), bool)
    padded[: mask.shape[0], : mask.shape[1]] = mask
    return np.asarray(padded.reshape(height, factor, width, factor).any(axis=(1, 3)))
