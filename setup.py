"""Compiles the native kernels: plain C functions that the cores call through ctypes (`lupin_runtime/native.py`).

`LUPIN_PURE=1` builds without them, which is what a robot gets: nothing that runs there needs one. A wheel carries the
playbooks and units inside `lupin_cli/data`, where `lupin_cli/package_data.py` looks for them.
"""

import os
import shutil
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.build_py import build_py

SHIPPED = ("playbooks", "systemd")


class BuildWithShippedData(build_py):
    """Copies the data folders beside the packages into the wheel."""

    def run(self):
        """Build the package, then copy the data unless the installation is editable and reads the source tree."""
        super().run()
        if self.editable_mode:
            return
        for name in SHIPPED:
            shutil.copytree(name, Path(self.build_lib) / "lupin_cli" / "data" / name, dirs_exist_ok=True)


# Every `_kernels.c` is one library beside its core. No -ffast-math: NaN checks must keep their meaning.
FLAGS = ["-std=gnu11", "-O3", "-fno-math-errno", "-fno-trapping-math", "-Wall", "-Wextra", "-Wno-unused-parameter"]

kernels = [] if os.environ.get("LUPIN_PURE") == "1" else sorted(Path("lupin_runtime").rglob("_kernels.c"))

setup(
    cmdclass={"build_py": BuildWithShippedData},
    ext_modules=[
        Extension(
            ".".join(source.with_suffix("").parts),
            [str(source)],
            depends=[str(header) for header in sorted(source.parent.glob("*.h"))],
            extra_compile_args=FLAGS,
            libraries=["m"],
        )
        for source in kernels
    ],
)
