"""Which files a robot needs: the runtime, and what the robot's own system doesn't have.

A robot with a ROS installation uses that one: our interface packages travel as sources and are built there. A robot without one
gets the wheels that this machine runs on, file by file as they are installed here, so that no deploy needs the internet.
"""

from __future__ import annotations

import importlib.util
import json
import os
import platform
import sys
from collections.abc import Iterator
from pathlib import Path

from lupin_cli import __version__
from lupin_cli.quick_dataclass import dataclass

RUNTIME_SUFFIXES = {".py", ".json", ".yaml", ".c"}
# What onboard processes import from the index where the robot has no ROS.
ROOTS = ("ros-jazzy-rclpy", "ros-jazzy-common-interfaces", "ros-rmw-fastrtps-cpp", "lupin-interfaces", "pyyaml", "psutil")
# Only builders of interface packages need these.
LEFT_OUT_FOLDERS = ("include/", "share/man/", "share/doc/")
LEFT_OUT_PARTS = {"__pycache__", "tests", "test"}
LEFT_OUT_SUFFIXES = (".pyc", ".h", ".hpp", ".cmake", ".em", ".a")


class CannotBuild(Exception):
    """No release can be made here for that robot, and why."""


@dataclass(frozen=True)
class Robot:
    """What a release depends on."""

    machine: str  # as `uname -m` says: x86_64, aarch64
    python: tuple[int, int]
    ros: str  # the distribution under /opt/ros, or empty

    def __str__(self) -> str:
        ros = f"ROS {self.ros}" if self.ros else "no ROS"
        return f"{self.machine}, Python {self.python[0]}.{self.python[1]}, {ros}"


def files(robot: Robot) -> Iterator[tuple[str, str | bytes]]:
    """Path in the release and content of each file; raises CannotBuild."""
    if robot.python < (3, 10):
        raise CannotBuild(f"the runtime needs Python 3.10 or newer; the robot has {robot}")
    site = f"venv/lib/python{robot.python[0]}.{robot.python[1]}/site-packages"
    yield "release.json", _description(robot)
    yield "venv/pyvenv.cfg", _pyvenv(robot)
    for path in sorted(_package("lupin_runtime").rglob("*")):
        if path.suffix in RUNTIME_SUFFIXES and path.is_file():
            yield f"{site}/{path.relative_to(_package('lupin_runtime').parent)}", str(path)
    if robot.ros:
        yield from _interface_sources()
    else:
        yield from _wheels(robot)


def _description(robot: Robot) -> bytes:
    text = {"version": __version__, "machine": robot.machine, "python": list(robot.python), "ros": robot.ros}
    return (json.dumps(text, indent=2, sort_keys=True) + "\n").encode()


def _pyvenv(robot: Robot) -> bytes:
    # A virtual environment is this file beside bin/python3. What a ROS installation brings is reached through the system's.
    system = "true" if robot.ros else "false"
    return f"home = /usr/bin\ninclude-system-site-packages = {system}\nversion = {robot.python[0]}.{robot.python[1]}\n".encode()


def _package(name: str) -> Path:
    spec = importlib.util.find_spec(name)
    if spec is None or spec.origin is None:
        raise CannotBuild(f"the package {name} is not installed here: make setup")
    return Path(spec.origin).parent


def _interface_sources() -> Iterator[tuple[str, str | bytes]]:
    folder = Path(sys.prefix) / "share" / "lupin_msgs"
    names = sorted(path for kind in ("msg", "srv", "action") for path in folder.glob(f"{kind}/*.{kind}"))
    if not names:
        raise CannotBuild(f"the interface package lupin_msgs is not installed in {sys.prefix}: make setup")
    yield "ws/src/lupin_msgs/package.xml", str(folder / "package.xml")
    yield "ws/src/lupin_msgs/CMakeLists.txt", str(folder / "CMakeLists.txt")
    for path in names:
        yield f"ws/src/lupin_msgs/{path.relative_to(folder)}", str(path)


def _wheels(robot: Robot) -> Iterator[tuple[str, str | bytes]]:
    here = (platform.machine(), (sys.version_info.major, sys.version_info.minor))
    if here != (robot.machine, robot.python):
        raise CannotBuild(
            f"without ROS the robot runs the packages of this machine, which has {Robot(*here, ros='')}; the robot has {robot}"
        )
    from importlib.metadata import distribution as installed

    prefix = sys.prefix + "/"
    for name in sorted(_closure(ROOTS)):
        distribution = installed(name)
        site = str(distribution.locate_file(""))
        # RECORD's first column, without the objects that `files` makes of ten thousand lines at every deploy.
        for line in (distribution.read_text("RECORD") or "").splitlines():
            source = os.path.normpath(f"{site}/{line.split(',', 1)[0]}")
            path = source.removeprefix(prefix)
            if path == source or path.startswith(LEFT_OUT_FOLDERS) or path.endswith(LEFT_OUT_SUFFIXES):
                continue
            # Scripts name this machine's interpreter in their first line; programs are the same anywhere.
            if LEFT_OUT_PARTS & set(path.split("/")) or (path.startswith("bin/") and _is_script(source)):
                continue
            yield f"venv/{path}", source


def _is_script(path: str) -> bool:
    with Path(path).open("rb") as file:
        return file.read(2) == b"#!"


def _closure(roots: tuple[str, ...]) -> set[str]:
    """The distributions that `roots` need, themselves included, by normalised name."""
    from importlib.metadata import PackageNotFoundError, distribution

    from packaging.requirements import Requirement
    from packaging.utils import canonicalize_name

    found: set[str] = set()
    waiting: list[tuple[str, frozenset[str]]] = [(canonicalize_name(root), frozenset()) for root in roots]
    seen = set(waiting)
    while waiting:
        name, extras = waiting.pop()
        try:
            requires = distribution(name).requires or []
        except PackageNotFoundError as error:
            raise CannotBuild(f"the package {name} is not installed here: make setup") from error
        found.add(name)
        for text in requires:
            requirement = Requirement(text)
            environments = [{"extra": extra} for extra in extras or {""}]
            if requirement.marker and not any(map(requirement.marker.evaluate, environments)):
                continue
            item = (canonicalize_name(requirement.name), frozenset(requirement.extras))
            if item not in seen:
                seen.add(item)
                waiting.append(item)
    return found - {"setuptools"}
