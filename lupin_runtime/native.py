"""Loads the C kernels that `setup.py` compiles beside a core."""

from __future__ import annotations

import ctypes
import sysconfig
from pathlib import Path


class KernelsMissing(ImportError):
    """The compiled kernels of a package are missing."""


def load_kernels(package: Path) -> ctypes.CDLL:
    """Load the compiled `_kernels.c` of the folder `package`. Calls release the GIL.

    Callers declare `argtypes` with `numpy.ctypeslib.ndpointer(dtype, ndim, flags="C_CONTIGUOUS")`, so that an array of the
    wrong shape is refused before C is called. Raises KernelsMissing with the command that builds them.
    """
    library = package / f"_kernels{sysconfig.get_config_var('EXT_SUFFIX')}"
    if not library.exists():
        raise KernelsMissing(f"{library} is not built; run: make setup")
    return ctypes.CDLL(str(library))
