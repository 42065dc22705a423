"""Distinguishes a room's outer walls from the boxes in it."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from lupin_runtime.gridmap import GridMap

Floats = NDArray[np.float64]

WALL_BAND_M = 0.2  # outer walls of a SLAM map are straight within this; every box is deeper
_MIN_ROOM_M = 1.0
_MIN_WALL_M = 2.5


def find_outer_walls(grid: GridMap, rows: Floats, labels: NDArray[np.int32], stats: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Return a mask (n,) of the surfaces that belong to outer walls.

    Outer walls lie along the smallest rectangle around all occupied cells and face inwards. Boxes against a wall are deeper
    than WALL_BAND_M, and their sides face along the wall. If no wall encloses the area, only long components that lie
    entirely within the band are walls, so that boxes in the open are not mistaken for walls.

    `rows` (n, 4) are surfaces; `labels` (height, width) and `stats` are the components of the occupied cells.
    """
    walls = np.zeros(len(rows), bool)
    occupied_rows, occupied_columns = np.nonzero(labels)
    if occupied_rows.size < 3 or not len(rows):
        return walls
    points = np.stack((occupied_columns, occupied_rows), axis=1).astype(np.float32)
    (cx, cy), (width, height), angle = cv2.minAreaRect(points)
    if min(width, height) * grid.resolution_m < _MIN_ROOM_M:
        return walls
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))

    def distances_to_edges(columns: Floats, rows_: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return meters to the nearer edge along each axis of the rectangle, and the inward sign along each axis."""
        u, v = c * (columns - cx) + s * (rows_ - cy), -s * (columns - cx) + c * (rows_ - cy)
        du, dv = (width / 2 - np.abs(u)) * grid.resolution_m, (height / 2 - np.abs(v)) * grid.resolution_m
        return du, dv, -np.sign(u), -np.sign(v)

    spans = stats[:, cv2.CC_STAT_WIDTH].astype(float) * stats[:, cv2.CC_STAT_HEIGHT]
    spans[0] = 0.0
    columns, rows_ = (rows[:, 0] - grid.origin_x) / grid.resolution_m, (rows[:, 1] - grid.origin_y) / grid.resolution_m
    du, dv, inward_u, inward_v = distances_to_edges(columns - 0.5, rows_ - 0.5)
    facing_u = inward_u * (c * rows[:, 2] + s * rows[:, 3])
    facing_v = inward_v * (-s * rows[:, 2] + c * rows[:, 3])
    in_band: NDArray[np.bool_] = ((du <= WALL_BAND_M) & (facing_u >= 0.7)) | ((dv <= WALL_BAND_M) & (facing_v >= 0.7))
    # A component that spans half of the occupied area is the enclosing wall.
    if spans.max() >= 0.5 * (np.ptp(occupied_rows) + 1.0) * (np.ptp(occupied_columns) + 1.0):
        return in_band
    depth = np.zeros(len(stats))
    du, dv, _, _ = distances_to_edges(occupied_columns.astype(float), occupied_rows.astype(float))
    np.maximum.at(depth, labels[occupied_rows, occupied_columns], np.minimum(du, dv))
    length = np.maximum(stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT]) * grid.resolution_m
    is_wall = (depth <= WALL_BAND_M) & (length >= _MIN_WALL_M)
    # The cell behind a surface is on the far side from its normal.
    behind_rows = np.clip(np.floor(rows_ - np.sign(np.round(rows[:, 3]))).astype(int), 0, grid.height - 1)
    behind_columns = np.clip(np.floor(columns - np.sign(np.round(rows[:, 2]))).astype(int), 0, grid.width - 1)
    behind = labels[behind_rows, behind_columns]
    result: NDArray[np.bool_] = in_band & is_wall[behind] & (behind > 0)
    return result
