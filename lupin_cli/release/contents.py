"""The files of a release: the runtime, and the packages that it needs and the robot lacks.

A robot with a ROS installation uses that one; it gets our interface package as sources and builds them. A robot without ROS
gets the packages that are installed on this machine, copied file by file, so that no deploy needs the internet.
"""

from __future__ import annotations

import importlib.util
import json
import os
import platform
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from lupin_cli import __version__

RUNTIME_SUFFIXES = {".py", ".json", ".yaml", ".c"}
# The distributions that the onboard processes import, for a robot without ROS.
ROOTS = ("ros-jazzy-rclpy", "ros-jazzy-common-interfaces", "ros-rmw-fastrtps-cpp", "numpy", "pyyaml", "psutil")
# The distributions that may contain the interface packages: their own in a checkout, Lupin's in its wheel.
INTERFACES, LUPIN = "lupin-interfaces", "lupin"
OWN_PACKAGES = {"lupin_cli", "lupin_runtime", "lupin_sim"}
# Files that only builds of interface packages need.
EXCLUDED_FOLDERS = ("include/", "share/man/", "share/doc/")
EXCLUDED_PARTS = {"__pycache__", "tests", "test"}
EXCLUDED_SUFFIXES = (".pyc", ".h", ".hpp", ".cmake", ".em", ".a")


class ReleaseError(Exception):
    """No release can be built on this machine for that robot; the message says why."""


@dataclass(frozen=True)
class RobotPlatform:
    """The properties of a robot that the content of a release depends on."""

    machine: str  # as printed by `uname -m`: x86_64, aarch64
    python: tuple[int, int]
    ros: str  # the distribution below /opt/ros, or empty

    def __str__(self) -> str:
        ros = f"ROS {self.ros}" if self.ros else "no ROS"
        return f"{self.machine}, Python {self.python[0]}.{self.python[1]}, {ros}"


def release_files(robot: RobotPlatform) -> Iterator[tuple[str, str | bytes]]:
    """Yield each file of the release: its path in the release, and its content (bytes) or path on this machine (str).

    Raises ReleaseError.
    """
    if robot.python < (3, 10):
        raise ReleaseError(f"the runtime needs Python 3.10 or newer; the robot has {robot}")
    site = f"venv/lib/python{robot.python[0]}.{robot.python[1]}/site-packages"
    yield "release.json", _release_json(robot)
    yield "venv/pyvenv.cfg", _pyvenv_cfg(robot)
    for path in sorted(_package_folder("lupin_runtime").rglob("*")):
        if path.suffix in RUNTIME_SUFFIXES and path.is_file():
            yield f"{site}/{path.relative_to(_package_folder('lupin_runtime').parent)}", str(path)
    if robot.ros:
        yield from _interface_sources()
    else:
        yield from _installed_packages(robot)


def _release_json(robot: RobotPlatform) -> bytes:
    text = {"version": __version__, "machine": robot.machine, "python": list(robot.python), "ros": robot.ros}
    return (json.dumps(text, indent=2, sort_keys=True) + "\n").encode()


def _pyvenv_cfg(robot: RobotPlatform) -> bytes:
    # This file makes the folder a virtual environment. On a robot with ROS, it also uses ROS's packages of the system's Python.
    system = "true" if robot.ros else "false"
    return f"home = /usr/bin\ninclude-system-site-packages = {system}\nversion = {robot.python[0]}.{robot.python[1]}\n".encode()


def _package_folder(name: str) -> Path:
    spec = importlib.util.find_spec(name)
    if spec is None or spec.origin is None:
        raise ReleaseError(f"the package {name} is not installed here: make setup")
    return Path(spec.origin).parent


def _interface_sources() -> Iterator[tuple[str, str | bytes]]:
    folder = Path(sys.prefix) / "share" / "lupin_msgs"
    names = sorted(path for kind in ("msg", "srv", "action") for path in folder.glob(f"{kind}/*.{kind}"))
    if not names:
        raise ReleaseError(f"the interface package lupin_msgs is not installed in {sys.prefix}: make setup")
    yield "ws/src/lupin_msgs/package.xml", str(folder / "package.xml")
    yield "ws/src/lupin_msgs/CMakeLists.txt", str(folder / "CMakeLists.txt")
    for path in names:
        yield f"ws/src/lupin_msgs/{path.relative_to(folder)}", str(path)


def _installed_packages(robot: RobotPlatform) -> Iterator[tuple[str, str | bytes]]:
    this_machine = (platform.machine(), (sys.version_info.major, sys.version_info.minor))
    if this_machine != (robot.machine, robot.python):
        raise ReleaseError(
            f"a robot without ROS gets the packages of this machine, which has {RobotPlatform(*this_machine, ros='')}; "
            f"the robot has {robot}"
        )
    from importlib.metadata import distribution as find_distribution

    prefix = sys.prefix + "/"
    for name in sorted(_closure(ROOTS) | {_interfaces_distribution()}):
        distribution = find_distribution(name)
        site = str(distribution.locate_file(""))
        # The first column of RECORD. `distribution.files` would create ten thousand objects at every deploy.
        for line in (distribution.read_text("RECORD") or "").splitlines():
            if name == LUPIN and line.split("/", 1)[0] in OWN_PACKAGES:
                continue
            source = os.path.normpath(f"{site}/{line.split(',', 1)[0]}")
            path = source.removeprefix(prefix)
            if path == source or path.startswith(EXCLUDED_FOLDERS) or path.endswith(EXCLUDED_SUFFIXES):
                continue
            # Scripts are left out: their first line names this machine's interpreter. Binaries run anywhere.
            if EXCLUDED_PARTS & set(path.split("/")) or (path.startswith("bin/") and _is_script(source)):
                continue
            yield f"venv/{path}", source


def _interfaces_distribution() -> str:
    """Return the name of the installed distribution that contains the interface packages. Raises ReleaseError."""
    from importlib.metadata import PackageNotFoundError, distribution

    for name in (INTERFACES, LUPIN):
        try:
            if "\nlupin_msgs/__init__.py," in (distribution(name).read_text("RECORD") or ""):
                return name
        except PackageNotFoundError:
            continue
    raise ReleaseError("the interface package lupin_msgs is not installed here: make setup")


def _is_script(path: str) -> bool:
    with Path(path).open("rb") as file:
        return file.read(2) == b"#!"


def _closure(roots: tuple[str, ...]) -> set[str]:
    """Return the normalized names of the distributions in `roots` and of all that they require. Raises ReleaseError."""
    from importlib.metadata import PackageNotFoundError, distribution

    from packaging.requirements import Requirement
    from packaging.utils import canonicalize_name

    found: set[str] = set()
    pending: list[tuple[str, frozenset[str]]] = [(canonicalize_name(root), frozenset()) for root in roots]
    seen = set(pending)
    while pending:
        name, extras = pending.pop()
        try:
            requires = distribution(name).requires or []
        except PackageNotFoundError as error:
            raise ReleaseError(f"the package {name} is not installed here: make setup") from error
        found.add(name)
        for text in requires:
            requirement = Requirement(text)
            environments = [{"extra": extra} for extra in extras or {""}]
            if requirement.marker and not any(map(requirement.marker.evaluate, environments)):
                continue
            item = (canonicalize_name(requirement.name), frozenset(requirement.extras))
            if item not in seen:
                seen.add(item)
                pending.append(item)
    return found - {"setuptools"}
