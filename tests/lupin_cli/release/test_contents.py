"""A release has every module that the robot's processes import."""

from __future__ import annotations

import ast
import platform
import re
import sys
from functools import cache
from pathlib import Path

import pytest

from lupin_cli.commands import home
from lupin_cli.package_data import shipped_folder
from lupin_cli.release.contents import RobotPlatform, release_files
from lupin_runtime.stack.options import ONBOARD, ROBOT_CAMERAS, Options
from lupin_runtime.stack.table import rows

PROJECT = Path(__file__).resolve().parents[3]
LIKE_THIS_MACHINE = RobotPlatform(platform.machine(), sys.version_info[:2], "")
OPTIONAL_PACKAGES = {"cv2"}  # without it, raw images are refused, and the message says what to install
WITH_ROS = RobotPlatform("aarch64", (3, 10), "humble")


def robot_entry_modules() -> set[str]:
    """Return the modules that start on the robot: those in unit files, onboard nodes, camera drivers, and those of commands."""
    templates = "".join(path.read_text() for path in shipped_folder("systemd").glob("*.service.in"))
    modules = set(re.findall(r"-m (lupin_runtime[\w.]+)", templates))
    assert modules == {"lupin_runtime.stack.onboard", "lupin_runtime.arm.auto_home", "lupin_runtime.cameras.service"}
    started = [*rows(Options(target=ONBOARD)), *rows(Options(target=ROBOT_CAMERAS))]
    nodes = {node.path.split(":")[0] for row in started for node in row.nodes}
    assert len(nodes) >= 4, "expected the nodes of estop, drive, body and video"
    # A driver's command is -m MODULE ...
    drivers = {row.command(Options(target=ROBOT_CAMERAS))[1] for row in started if row.command is not None}
    return modules | nodes | drivers | {home.MODULE, "lupin_runtime.stack.process"}


def source_of(module: str) -> Path | None:
    """Return the file of a module of this project; None for a name that is not a module, such as a class."""
    path = PROJECT.joinpath(*module.split("."))
    candidates = (path / "__init__.py", path.with_suffix(".py"))
    return next((candidate for candidate in candidates if candidate.is_file()), None)


@cache
def imports_of(file: Path) -> set[str]:
    """Return the modules that a file imports, when it is loaded or later, except for type checking."""
    found: set[str] = set()

    def visit(node: ast.AST) -> None:
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            return
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            assert node.level == 0, f"{file}: the project has no relative imports"
            found.update({node.module, *(f"{node.module}.{alias.name}" for alias in node.names)})
        for child in ast.iter_child_nodes(node):
            visit(child)

    visit(ast.parse(file.read_text(encoding="utf-8")))
    return found


def import_closure(modules: set[str]) -> tuple[set[str], set[str]]:
    """Return the project's modules that these import, directly or not, and the top-level names of third-party modules."""
    own: set[str] = set()
    third_party: set[str] = set()
    pending = set(modules)
    while pending:
        module = pending.pop()
        if not module.startswith("lupin_runtime"):
            third_party.add(module.split(".")[0])
            continue
        source = source_of(module)
        if module in own or source is None:
            continue
        own.add(module)
        pending |= imports_of(source)
        if package := module.rpartition(".")[0]:
            pending.add(package)
    return own, third_party - set(sys.stdlib_module_names)


@pytest.mark.parametrize("robot", [LIKE_THIS_MACHINE, WITH_ROS], ids=str)
def test_release_has_all_project_modules_of_the_robot(robot: RobotPlatform) -> None:
    site = f"venv/lib/python{robot.python[0]}.{robot.python[1]}/site-packages"
    paths = {path for path, _ in release_files(robot)}
    own, third_party = import_closure(robot_entry_modules())
    assert len(own) > 30
    assert not {"lupin_cli", "lupin_sim"} & third_party
    missing = []
    for module in own:
        source = source_of(module)
        assert source is not None
        if f"{site}/{source.relative_to(PROJECT)}" not in paths:
            missing.append(module)
    assert missing == []


def test_release_without_ros_has_all_third_party_packages() -> None:
    site = f"venv/lib/python{LIKE_THIS_MACHINE.python[0]}.{LIKE_THIS_MACHINE.python[1]}/site-packages/"
    names = {
        re.split(r"[/.]", path.removeprefix(site))[0] for path, _ in release_files(LIKE_THIS_MACHINE) if path.startswith(site)
    }
    _, third_party = import_closure(robot_entry_modules())
    assert {"rclpy", "geometry_msgs"} <= third_party, "expected the imports of the onboard nodes"
    assert (third_party - OPTIONAL_PACKAGES) | {"lupin_msgs", "mirte_msgs"} <= names


def test_robot_with_ros_needs_only_what_ros_installs() -> None:
    _, third_party = import_closure(robot_entry_modules())
    assert {name for name in third_party if not name.endswith(("_msgs", "_srvs", "_interfaces"))} == {
        "rclpy",
        "numpy",  # imported by every generated ROS message class
        "yaml",  # imported by ROS launch
        *OPTIONAL_PACKAGES,
    }
