"""Surfaces of a grid map: the sides of everything that is not free, on which tags may hang."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lupin_runtime.gridmap import UNKNOWN, GridMap
from lupin_runtime.mission.outer_walls import find_outer_walls

_MIN_COMPONENT_CELLS = 3  # smaller components are specks
_NORMAL_FIT_M = 0.15


@dataclass(frozen=True)
class Surfaces:
    """The boundary between free space and everything else, one row per cell side.

    `rows` is float64 (n, 4): x and y of the free cell in front, then the unit outward normal. `wall` (n,) marks the room's
    outer walls. `unknown` (n,) marks sides of unknown cells: no lidar beam has shown what is there.
    """

    rows: NDArray[np.float64]
    wall: NDArray[np.bool_]
    unknown: NDArray[np.bool_]


def find_surfaces(grid: GridMap, free_thresh: int = 20, occupied_thresh: int = 65) -> Surfaces:
    """Return every cell side between a free cell and one that is not, with normals fitted over 0.15 m.

    Unknown cells count, since lidar beams miss a box's end that they pass at a flat angle. Specks of one or two occupied,
    or unknown, cells do not count. Thresholds are occupancies 0..100.
    """
    occupied = grid.cells >= occupied_thresh
    free = (grid.cells >= 0) & (grid.cells <= free_thresh)
    labels, stats = _components(occupied)
    unknown_labels, unknown_stats = _components(grid.cells == UNKNOWN)
    occupied_sides = (stats[:, cv2.CC_STAT_AREA] >= _MIN_COMPONENT_CELLS)[labels] & occupied
    unknown_sides = (unknown_stats[:, cv2.CC_STAT_AREA] >= _MIN_COMPONENT_CELLS)[unknown_labels] & (grid.cells == UNKNOWN)
    steps = ((0, 1), (0, -1), (1, 0), (-1, 0))  # (row, column): east, west, north, south
    faces = [(occupied_sides | unknown_sides) & _shifted(free, row, column) for row, column in steps]
    reach = max(1, round(_NORMAL_FIT_M / grid.resolution_m))
    rows, unknown = [], []
    for index, (step_row, step_column) in enumerate(steps):
        r, c = np.nonzero(faces[index])
        near = [_neighborhood(face, r, c, reach) for face in faces]
        # One or two sides do not define a line: they are steps of a slanted surface, whose sides' directions are averaged.
        count = near[index].sum(axis=1)
        first, second = (2, 3) if index < 2 else (0, 1)
        mixed = (near[first].sum(axis=1) - near[second].sum(axis=1)) / count
        slope = _slope(near[index], reach, across_columns=index < 2)
        tilt = np.where(count >= 3.0, slope * -(step_row + step_column), mixed)
        nx, ny = (np.full(len(r), float(step_column)), tilt) if index < 2 else (tilt, np.full(len(r), float(step_row)))
        length = np.hypot(nx, ny)
        x = grid.origin_x + (c + step_column + 0.5) * grid.resolution_m
        y = grid.origin_y + (r + step_row + 0.5) * grid.resolution_m
        rows.append(np.stack((x, y, nx / length, ny / length), axis=1))
        unknown.append(unknown_sides[r, c])
    table = np.ascontiguousarray(np.concatenate(rows), np.float64)
    return Surfaces(table, find_outer_walls(grid, table, labels, stats), np.concatenate(unknown))


def _components(mask: NDArray[np.bool_]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return labels (height, width) of 8-connected components, 0 for the background, and OpenCV's statistics of each."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    return np.asarray(labels, np.int32), np.asarray(stats, np.int32)


def _neighborhood(mask: NDArray[np.bool_], r: NDArray[np.intp], c: NDArray[np.intp], reach: int) -> NDArray[np.float64]:
    """Return the mask in the square around each of n cells: (n, (2 reach + 1)^2), row-major, 0 outside the grid."""
    padded = np.pad(mask, reach)
    dr, dc = (d.ravel() for d in np.mgrid[0 : 2 * reach + 1, 0 : 2 * reach + 1])
    found: NDArray[np.float64] = padded[r[:, None] + dr, c[:, None] + dc].astype(np.float64)
    return found


def _slope(near: NDArray[np.float64], reach: int, across_columns: bool) -> NDArray[np.float64]:
    """Fit lines through the cells of `_neighborhood` and return their slopes: columns per row, or rows per column.

    Only sides with the same direction are fitted, so neither a corner nor the back of a thin wall tilts a normal.
    """
    t, u = (d.ravel() for d in np.mgrid[-reach : reach + 1, -reach : reach + 1])
    if not across_columns:
        t, u = u, t
    n, st, su, stt, stu = (near @ m for m in (np.ones(len(t)), t, u, t * t, t * u))
    spread = stt - st * st / n
    return np.where(spread > 0.5, (stu - st * su / n) / np.maximum(spread, 0.5), 0.0)


def _shifted(mask: NDArray[np.bool_], row: int, column: int) -> NDArray[np.bool_]:
    """Return result[r, c] = mask[r + row, c + column], False outside the mask."""
    result = np.zeros_like(mask)
    height, width = mask.shape
    result[max(0, -row) : height - max(0, row), max(0, -column) : width - max(0, column)] = mask[
        max(0, row) : height - max(0, -row), max(0, column) : width - max(0, -column)
    ]
    return result
