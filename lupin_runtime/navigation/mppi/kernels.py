"""The C kernels of this folder: their structures, and the memory that a controller passes to them."""

from __future__ import annotations

from ctypes import POINTER, Structure, c_float, c_int32, c_int64, c_uint64, c_void_p
from pathlib import Path

import numpy as np
from numpy.ctypeslib import ndpointer

from lupin_runtime.native import load_kernels

_F32 = ndpointer(np.float32, 1, flags="C_CONTIGUOUS")
_F32_2D = ndpointer(np.float32, 2, flags="C_CONTIGUOUS")


class KernelParameters(Structure):
    """The struct `Settings` of _kernels.c: the parameters that are constant over all cycles."""

    _fields_ = (
        *((name, c_int32) for name in ("tiles", "batch", "steps", "align_step")),
        ("dt", c_float),
        ("std", c_float * 3),
        ("acceleration", c_float * 3),
        ("deceleration_x", c_float),
        *((name, c_float) for name in ("gamma", "temperature", "max_speed", "min_speed", "constraint_weight")),
        *((name, c_float) for name in ("collision_cost", "critical_weight", "repulsion_weight", "collision_margin")),
        *((name, c_float) for name in ("inflation_radius", "goal_weight", "goal_angle_weight", "align_weight")),
        *((name, c_float) for name in ("follow_weight", "angle_weight", "forward_weight")),
        *((name, c_int32) for name in ("align_offset", "follow_offset", "angle_offset")),
        *((name, c_float) for name in ("align_occupancy", "angle_max")),
    )


class CycleInputs(Structure):
    """The struct `Scene` of _kernels.c: the inputs that change with every cycle."""

    _fields_ = (
        ("velocity", c_float * 3),
        *((name, c_float) for name in ("yaw", "goal_x", "goal_y", "goal_yaw", "grid_x", "grid_y", "cells_per_meter")),
        *((name, c_int32) for name in ("grid_height", "grid_width")),
        *((name, c_float) for name in ("collision_distance", "margin_reach", "path_points_per_meter")),
        *((name, c_int32) for name in ("path_size", "use_repulsion", "use_goal", "use_goal_angle", "use_align")),
        *((name, c_int32) for name in ("use_follow", "use_angle", "use_forward")),
    )


class CycleResult(Structure):
    """The struct `Outcome` of _kernels.c: statistics of one cycle."""

    _fields_ = (
        ("best_cost", c_float),
        *((name, c_int32) for name in ("best", "furthest_path_index", "collision_free_count", "mean_contact_step")),
        ("best_contact_step", c_int32),
    )


_library = load_kernels(Path(__file__).parent)
_library.lanes.restype = c_int64
_library.tile_bytes.restype = c_int64

LANES = int(_library.lanes())
TILE_BYTES = int(_library.tile_bytes())

optimize = _library.optimize
optimize.restype = c_int64
optimize.argtypes = [
    *(POINTER(KernelParameters), POINTER(CycleInputs), _F32_2D, c_void_p, _F32_2D),
    *(_F32, _F32, _F32, _F32, _F32, _F32, c_void_p, _F32_2D, POINTER(CycleResult)),
]

first_contact = _library.first_contact
first_contact.restype = c_int64
first_contact.argtypes = [POINTER(KernelParameters), POINTER(CycleInputs), _F32_2D, _F32_2D]

_fill_normal = _library.fill_normal
_fill_normal.restype = None
_fill_normal.argtypes = [c_uint64, _F32, c_int64]


def unit_normals(seed: int, count: int) -> np.ndarray:
    """Draw `count` float32 samples of a unit normal; the seed determines them."""
    out = np.empty(count, np.float32)
    _fill_normal(seed & 0xFFFFFFFFFFFFFFFF, out, count)
    return out
