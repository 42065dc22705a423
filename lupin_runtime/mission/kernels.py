"""The mission's compiled kernels (`_kernels.c`): what a camera sees of a map's surfaces, and travel distances on it."""

from __future__ import annotations

import ctypes
import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2
from lupin_runtime.gridmap import GridMap
from lupin_runtime.mission.clearance import ClearanceMap
from lupin_runtime.native import load_kernels

Floats = NDArray[np.float64]

_MAX_START_OFFSET_M = 0.5


@dataclass(frozen=True)
class CameraModel:
    """What the body camera can resolve: meters and radians; the camera is `x_m` ahead of the base and looks along +x.

    A tag of `tag_edge_m` is readable if it appears at least `min_tag_px` wide, foreshortening included (36h11 is always
    detected at 20 px). The field of view is narrowed by a margin, so that a tag at the edge counts only when the whole tag
    was in the image.
    """

    x_m: float = 0.147
    min_range_m: float = 0.30
    max_range_m: float = 1.8
    half_fov_rad: float = math.radians(27.0)
    max_incidence_rad: float = math.radians(66.0)
    focal_px: float = 554.25
    tag_edge_m: float = 0.1
    min_tag_px: float = 23.0


class _View(ctypes.Structure):
    """The struct `View` of _kernels.c."""

    _fields_ = [
        *((name, ctypes.c_double) for name in ("resolution", "origin_x", "origin_y")),
        *((name, ctypes.c_double) for name in ("camera_x", "min_range", "max_range")),
        *((name, ctypes.c_double) for name in ("cos_half_fov", "cos_incidence", "min_facing")),
        *((name, ctypes.c_int32) for name in ("height", "width", "occupied_thresh")),
    ]


@cache
def _kernels() -> ctypes.CDLL:
    library = load_kernels(Path(__file__).parent)
    grid = np.ctypeslib.ndpointer(np.int8, 2, flags="C_CONTIGUOUS")
    rows = np.ctypeslib.ndpointer(np.float64, 2, flags="C_CONTIGUOUS")
    vector = np.ctypeslib.ndpointer(np.float64, 1, flags="C_CONTIGUOUS")
    mask = np.ctypeslib.ndpointer(np.uint8, 2, flags="C_CONTIGUOUS")
    lengths = np.ctypeslib.ndpointer(np.float32, 2, flags="C_CONTIGUOUS")
    view, count = ctypes.POINTER(_View), ctypes.c_int64
    library.add_view_time.argtypes = [grid, view, rows, count, rows, count, vector]
    library.add_view_time.restype = None
    library.view_gain.argtypes = [grid, view, rows, vector, count, rows, count, vector]
    library.view_gain.restype = None
    library.view_matrix.argtypes = [grid, view, rows, count, rows, count, mask]
    library.view_matrix.restype = None
    library.travel_distance.argtypes = [mask, *[ctypes.c_int32] * 4, lengths]
    library.travel_distance.restype = ctypes.c_int32
    return library


class CameraView:
    """A camera on a grid map. Surfaces are rows (x, y, nx, ny), poses are rows (x, y, yaw, weight) of the robot's base."""

    def __init__(self, camera: CameraModel, grid: GridMap, occupied_thresh: int) -> None:
        self._cells = np.ascontiguousarray(grid.cells)
        self._view = _View(
            grid.resolution_m,
            grid.origin_x,
            grid.origin_y,
            camera.x_m,
            camera.min_range_m,
            camera.max_range_m,
            math.cos(camera.half_fov_rad),
            math.cos(camera.max_incidence_rad),
            camera.min_tag_px / (camera.focal_px * camera.tag_edge_m),
            grid.height,
            grid.width,
            occupied_thresh,
        )

    def add_view_time(self, surfaces: Floats, poses: Floats, seen_s: Floats) -> None:
        """Add to `seen_s` (n,), for each surface (n, 4), the weights of the poses (m, 4) that see it."""
        _kernels().add_view_time(self._cells, self._view, surfaces, len(surfaces), poses, len(poses), seen_s)

    def gains(self, surfaces: Floats, weights: Floats, poses: Floats) -> Floats:
        """Return for each pose (m, 4) the meters of surface that it sees, weighted with `weights` (n,): (m,)."""
        gains = np.zeros(len(poses))
        if len(surfaces) and len(poses):
            _kernels().view_gain(self._cells, self._view, surfaces, weights, len(surfaces), poses, len(poses), gains)
        meters: Floats = gains * self._view.resolution
        return meters

    def visibility(self, surfaces: Floats, poses: Floats) -> NDArray[np.bool_]:
        """Return a mask (m, n): whether pose m sees surface n."""
        visible = np.zeros((len(poses), len(surfaces)), np.uint8)
        _kernels().view_matrix(self._cells, self._view, surfaces, len(surfaces), poses, len(poses), visible)
        return visible.astype(bool)


def travel_distances(clearance: ClearanceMap, start: Pose2, room_m: float) -> NDArray[np.float32] | None:
    """Return the travel distance in meters from `start` to every cell (height, width), infinite for cells that no path reaches.

    Paths stay on cells that keep `room_m` to obstacles. Returns None if `start` is not within 0.5 m of such a cell.
    """
    grid = clearance.grid
    passable = np.ascontiguousarray(clearance.free & (clearance.distance_m >= room_m), np.uint8)
    row, column = grid.cell_of(start.x, start.y)
    reach = math.ceil(_MAX_START_OFFSET_M / grid.resolution_m)
    r0, c0 = max(0, row - reach), max(0, column - reach)
    near_rows, near_columns = np.nonzero(passable[r0 : max(0, row + reach + 1), c0 : max(0, column + reach + 1)])
    if near_rows.size == 0:
        return None
    nearest = np.argmin((near_rows + r0 - row) ** 2 + (near_columns + c0 - column) ** 2)
    cells = np.empty(passable.shape, np.float32)
    start_cell = (int(near_rows[nearest]) + r0, int(near_columns[nearest]) + c0)
    if _kernels().travel_distance(passable, grid.height, grid.width, *start_cell, cells) != 0:
        raise MemoryError(f"out of memory for the travel distances on a map of {grid.height} x {grid.width} cells")
    return cells * np.float32(grid.resolution_m)
