"""Finds the compilers, headers and ROS wheels that a build needs, and reports everything that is missing at once."""

import importlib
import os
import shlex
import shutil
import sys
import sysconfig
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Toolchain:
    """The compilers, and the folders of headers and libraries."""

    c_compiler: tuple[str, ...]
    cxx_compiler: tuple[str, ...]
    ros_prefix: Path
    include_dirs: tuple[Path, ...]
    optimization: str

    @property
    def library_dir(self) -> Path:
        """Where the ROS wheels put their shared libraries."""
        return self.ros_prefix / "lib"


def find_toolchain() -> Toolchain:
    """Find compilers, Python headers and ROS wheels.

    ``CC``, ``CXX`` and ``LUPIN_INTERFACES_OPTIMISATION`` (default ``-O1``: half the compile time of ``-O2``; the
    generated code only copies fields) override the defaults.

    Raises SystemExit with everything that is missing, and how to install it.
    """
    c_compiler = tuple(shlex.split(os.environ.get("CC", "gcc")))
    cxx_compiler = tuple(shlex.split(os.environ.get("CXX", "g++")))
    python_include = Path(sysconfig.get_paths()["include"])
    missing = [
        f"{' '.join(command)}: not found; sudo apt install {package}"
        for command, package in ((c_compiler, "gcc"), (cxx_compiler, "g++"))
        if not shutil.which(command[0])
    ]
    if not (python_include / "Python.h").exists():
        version = f"{sys.version_info.major}.{sys.version_info.minor}"
        missing.append(f"{python_include / 'Python.h'}: not found; sudo apt install python{version}-dev")
    if missing:
        raise SystemExit("building ROS interfaces needs:\n  " + "\n  ".join(missing))
    prefix = ros_wheels_prefix()
    return Toolchain(
        c_compiler=c_compiler,
        cxx_compiler=cxx_compiler,
        ros_prefix=prefix,
        include_dirs=(*_ros_include_dirs(prefix), python_include, _numpy_include()),
        optimization=os.environ.get("LUPIN_INTERFACES_OPTIMISATION", "-O1"),
    )


def ros_wheels_prefix() -> Path:
    """The prefix of the installed ROS wheels: a virtual environment, or pip's isolated build environment."""
    try:
        generator = importlib.import_module("rosidl_generator_c")
    except ImportError:
        raise SystemExit(
            "the ROS generators are not installed: build with isolation (without --no-build-isolation), "
            "or first: pip install ros-jazzy-common-interfaces==5.3.6 'empy>=3.3.4,<4' numpy"
        ) from None
    site_packages = Path(generator.__file__).resolve().parents[1]  # <prefix>/lib/python3.x/site-packages
    return site_packages.parents[2]


def _ros_include_dirs(prefix: Path) -> tuple[Path, ...]:
    include = prefix / "include"  # Jazzy's layout: include/<package>/<package>/*.h
    return (include, *sorted(d for d in include.iterdir() if d.is_dir() and not d.name.startswith("python")))


def _numpy_include() -> Path:
    import numpy

    return Path(numpy.get_include())
