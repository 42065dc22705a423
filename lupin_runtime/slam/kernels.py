"""`_kernels.c` as typed functions: ctypes checks array types and shapes before C is called."""

from __future__ import annotations

from ctypes import POINTER, byref, c_double, c_int, c_int32, c_int64
from pathlib import Path
from typing import Any

import numpy as np
from numpy.ctypeslib import ndpointer
from numpy.typing import NDArray

from lupin_runtime.native import load_kernels

Array = NDArray[np.floating]

_F = ndpointer(np.float64, flags="C_CONTIGUOUS")
_I = ndpointer(np.int32, flags="C_CONTIGUOUS")
_L = ndpointer(np.int64, flags="C_CONTIGUOUS")
_B = ndpointer(np.uint8, flags="C_CONTIGUOUS")
_C = ndpointer(np.int8, flags="C_CONTIGUOUS")
_N, _D, _OUT = c_int, c_double, POINTER(c_int32)
_GRID = [_D, _D, _D, _N, _N]  # x0, y0, cell, width, height

_SIGNATURES: dict[str, tuple[Any, list[Any]]] = {
    "scan_normals": (None, [_F, _N, _D, _D, _D, _F]),
    "add_surfels": (c_int, [_F, _F, _L, _L, _F, _N, *_GRID, _I, _F, _N, _B, _I, _OUT]),
    "finish_surfels": (None, [_F, _N]),
    "draw_field": (None, [_I, _N, _B, _N, _B, _N, _N]),
    "build_pyramid": (None, [_B, _N, _N, _N]),
    "search_window": (
        c_int,
        [_B, _N, _N, _N, _D, _D, _D, _F, _N, _D, _D, _F, _F, _N, _N, _D, _D, _I, _N, _I, POINTER(c_double)],
    ),
    "field_score": (_D, [_B, _N, _N, _D, _D, _D, _F, _N, _F]),
    "refine_pose": (c_int, [_F, _F, _F, _N, _I, _F, *_GRID, _F, _F, _F, _N, _D, _D, _F, _F]),
    "count_beams": (None, [_I, _I, _N, _N, _N, _N, _D, _F, _N, _F, _D, _D, _N]),
    "grade_cells": (None, [_I, _I, c_int64, _N, _D, _C]),
    "count_conflicts": (None, [_I, _I, _N, _N, _D, _D, _D, _F, _N, _F, _N, _OUT, _OUT]),
    "particle_scores": (None, [_F, _N, _F, _N, _B, _N, _N, _D, _D, _D, _F, _F]),
}

_library = load_kernels(Path(__file__).parent)
for _name, (_result, _arguments) in _SIGNATURES.items():
    _function = getattr(_library, _name)
    _function.restype, _function.argtypes = _result, _arguments


def scan_normals(xy: Array, sensor: tuple[float, float], step_rad: float) -> Array:
    """Unit normals (n, 2) of points (n, 2) in beam order, towards the sensor; zero where no line fits."""
    normal = np.empty_like(xy)
    _library.scan_normals(xy, len(xy), sensor[0], sensor[1], step_rad, normal)
    return normal


def add_surfels(
    xy: Array, normal: Array, start: NDArray[np.int64], count: NDArray[np.int64], poses: Array,
    corner: tuple[float, float], cell_m: float, shape: tuple[int, int], slot: NDArray[np.int32], surfel: Array, surfels: int,
    marked: NDArray[np.uint8], marks: NDArray[np.int32], mark_count: int,
) -> tuple[int, int]:  # fmt: skip
    """Add scans to a surfel raster; returns the new numbers of surfels and of marked cells."""
    total = int(count.sum())
    if surfels + total > len(surfel) or mark_count + total > len(marks):
        raise ValueError(f"{total} more points do not fit into {len(surfel)} surfels")
    listed = c_int32(mark_count)
    height, width = shape
    surfels = _library.add_surfels(
        xy, normal, start, count, poses, len(start), *corner, cell_m, width, height, slot, surfel, surfels, marked, marks,
        byref(listed),
    )  # fmt: skip
    return int(surfels), listed.value


def finish_surfels(surfel: Array, surfels: int) -> None:
    """Turn the surfels' sums into means."""
    _library.finish_surfels(surfel, surfels)


def draw_field(marks: NDArray[np.int32], count: int, stamp: NDArray[np.uint8], field: NDArray[np.uint8]) -> None:
    """Stamp every marked cell into `field` (height, width), keeping maxima."""
    height, width = field.shape
    _library.draw_field(marks, count, stamp, stamp.shape[0] // 2, field, width, height)


def build_pyramid(pyramid: NDArray[np.uint8]) -> None:
    """Fill the levels above 0 of `pyramid` (levels, height, width)."""
    levels, height, width = pyramid.shape
    _library.build_pyramid(pyramid, levels, width, height)


def search_window(
    pyramid: NDArray[np.uint8], corner: tuple[float, float], cell_m: float, xy: Array, center: tuple[float, float],
    yaws: Array, yaw_penalty: Array, half_cells: int, place_penalty: float, floor: float, avoid: NDArray[np.int32],
) -> tuple[float, int, int, int] | None:  # fmt: skip
    """Find the best pose of a window: (score, index of yaw, columns and rows from the center), or None below `floor`.

    `avoid` (k, 5) excludes boxes: index of yaw, column, row of their center, and their half widths in yaws and in cells.
    """
    levels, height, width = pyramid.shape
    found = np.empty(3, np.int32)
    score = c_double()
    status = _library.search_window(
        pyramid, levels, width, height, *corner, cell_m, xy, len(xy), *center, yaws, yaw_penalty, len(yaws), half_cells,
        place_penalty, floor, avoid, len(avoid), found, byref(score),
    )  # fmt: skip
    if status < 0:
        raise MemoryError(f"no memory to search {len(yaws)} angles of {len(xy)} points")
    return (score.value, int(found[0]), int(found[1]), int(found[2])) if status else None


def field_score(field: NDArray[np.uint8], corner: tuple[float, float], cell_m: float, xy: Array, pose: Array) -> float:
    """Mean of the field, 0 to 1, at the points of a scan at a pose (3,)."""
    height, width = field.shape
    return float(_library.field_score(field, width, height, *corner, cell_m, xy, len(xy), pose))


def refine_pose(
    xy: Array, normal: Array, sigma: Array, slot: NDArray[np.int32], surfel: Array, corner: tuple[float, float],
    cell_m: float, shape: tuple[int, int], pose: Array, prior: Array, prior_information: Array, iterations: int,
    gate_m: float, gate_end_m: float,
) -> tuple[Array, Array, int, int, float]:  # fmt: skip
    """Refine a pose (3,): (pose, information of the measurement alone, partners, inliers within 3 sigma, mean distance)."""
    height, width = shape
    pose, information, stats = pose.copy(), np.empty((3, 3)), np.zeros(3)
    partners = _library.refine_pose(
        xy, normal, sigma, len(xy), slot, surfel, *corner, cell_m, width, height, pose, prior,
        np.ascontiguousarray(prior_information), iterations, gate_m, gate_end_m, information, stats,
    )  # fmt: skip
    return pose, information, int(partners), int(stats[0]), float(stats[2])


def count_beams(
    seen: NDArray[np.int32], hit: NDArray[np.int32], first: tuple[int, int], cell_m: float, xy: Array, pose: Array,
    sensor: tuple[float, float], sign: int,
) -> None:  # fmt: skip
    """Add (sign 1) or remove (-1) the beams of a scan from `sensor` to `xy`, both in the frame of `pose`.

    `first` is the (column, row) of the raster's first cell, counted from the frame's origin.
    """
    height, width = seen.shape
    _library.count_beams(seen, hit, width, height, *first, cell_m, xy, len(xy), pose, *sensor, sign)


def grade_cells(seen: NDArray[np.int32], hit: NDArray[np.int32], min_beams: int, share: float) -> NDArray[np.int8]:
    """Turn counters into occupancy (height, width): -1, 0 or 100."""
    grid = np.empty(seen.shape, np.int8)
    _library.grade_cells(seen, hit, seen.size, min_beams, share, grid)
    return grid


def count_conflicts(
    seen: NDArray[np.int32], hit: NDArray[np.int32], corner: tuple[float, float], cell_m: float, xy: Array, pose: Array,
    reach: int,
) -> tuple[int, int]:  # fmt: skip
    """Count (points in space that beams have crossed, points in cells that beams have met)."""
    height, width = seen.shape
    conflicts, known = c_int32(), c_int32()
    _library.count_conflicts(
        seen, hit, width, height, *corner, cell_m, xy, len(xy), pose, reach, byref(conflicts), byref(known)
    )
    return conflicts.value, known.value


def particle_scores(
    particles: Array, xy: Array, distance: NDArray[np.uint8], corner: tuple[float, float], cell_m: float, table: Array
) -> Array:
    """Sum of `table[distance]` over the points for every particle (n, 3)."""
    height, width = distance.shape
    score = np.empty(len(particles))
    _library.particle_scores(particles, len(particles), xy, len(xy), distance, width, height, *corner, cell_m, table, score)
    return score
