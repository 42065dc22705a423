"""Compiles the native kernels: plain C functions that the cores call through ctypes (`lupin_runtime/native.py`).

`LUPIN_PURE=1` builds without them, which is what a robot gets: nothing that runs there needs one.
"""

import os
from pathlib import Path

from setuptools import Extension, setup

# Every `_kernels.c` is one library beside its core. No -ffast-math: NaN checks must keep their meaning.
FLAGS = ["-std=gnu11", "-O3", "-fno-math-errno", "-fno-trapping-math", "-Wall", "-Wextra", "-Wno-unused-parameter"]

kernels = [] if os.environ.get("LUPIN_PURE") == "1" else sorted(Path("lupin_runtime").rglob("_kernels.c"))

setup(
    ext_modules=[
        Extension(
            ".".join(source.with_suffix("").parts),
            [str(source)],
            depends=[str(header) for header in sorted(source.parent.glob("*.h"))],
            extra_compile_args=FLAGS,
            libraries=["m"],
        )
        for source in kernels
    ]
)
