"""Loads the C kernels that `setup.py` compiles beside a core."""

from __future__ import annotations

import ctypes
import sysconfig
from pathlib import Path


class KernelsMissing(ImportError):
    """The compiled kernels of a room are not where the build puts them."""


def load_kernels(room: Path) -> ctypes.CDLL:
    """The compiled `_kernels.c` of the folder `room`. Calls release the GIL.

    Callers declare `argtypes` with `numpy.ctypeslib.ndpointer(dtype, ndim, flags="C_CONTIGUOUS")`, so that an array of the
    wrong shape is refused before C sees it. Raises KernelsMissing with the command that builds them.
    """
    library = room / f"_kernels{sysconfig.get_config_var('EXT_SUFFIX')}"
    if not library.exists():
        raise KernelsMissing(f"{library} is not built; run: make setup  (or: python setup.py build_ext --inplace)")
    return ctypes.CDLL(str(library))
