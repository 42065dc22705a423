"""The builder sorts packages by dependency, reports missing tools, and rebuilds only changed packages."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.support.rosidl_build import load_rosidl_build

freshness, packages, toolchain = map(load_rosidl_build, ("freshness", "packages", "toolchain"))

TOOLS = toolchain.Toolchain(("true",), ("true",), Path("/ros"), (), "-O1")


def write_package(root: Path, name: str, definition: str = "uint8 a\n", depends: tuple[str, ...] = ()) -> Path:
    folder = root / name
    (folder / "msg").mkdir(parents=True)
    (folder / "msg" / "Thing.msg").write_text(definition)
    lines = [f"<name>{name}</name>", *(f"<depend>{depend}</depend>" for depend in depends)]
    (folder / "package.xml").write_text(f"<package format='3'>{''.join(lines)}</package>")
    return folder


@pytest.fixture(autouse=True)
def versions(monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """Fake and return the versions of the distributions for a build, which are installed only in the build environment."""
    installed = dict.fromkeys(freshness.BUILD_DISTRIBUTIONS, "1.0")
    monkeypatch.setattr(freshness.importlib.metadata, "version", installed.__getitem__)
    return installed


def keys(root: Path, tools: Any = TOOLS) -> dict[str, str]:
    result: dict[str, str] = freshness.build_keys(packages.discover(root), tools)
    return result


def test_packages_are_sorted_by_dependency(tmp_path: Path) -> None:
    write_package(tmp_path, "a_msgs", depends=("z_msgs", "std_msgs"))
    write_package(tmp_path, "m_msgs", depends=("a_msgs",))
    write_package(tmp_path, "z_msgs")
    assert [package.name for package in packages.discover(tmp_path)] == ["z_msgs", "a_msgs", "m_msgs"]


def test_circular_dependency_is_refused(tmp_path: Path) -> None:
    write_package(tmp_path, "a_msgs", depends=("b_msgs",))
    write_package(tmp_path, "b_msgs", depends=("a_msgs",))
    with pytest.raises(SystemExit, match=r"circle: a_msgs → b_msgs → a_msgs|circle: b_msgs → a_msgs → b_msgs"):
        packages.discover(tmp_path)


def test_folder_with_another_name_than_its_package_is_refused(tmp_path: Path) -> None:
    folder = write_package(tmp_path, "a_msgs").rename(tmp_path / "b_msgs")
    with pytest.raises(SystemExit, match="expected <name>b_msgs</name>, found <name>a_msgs</name>"):
        packages.read_package(folder)


def test_definitions_are_installed_in_the_share_folder(tmp_path: Path) -> None:
    package = packages.read_package(write_package(tmp_path, "a_msgs"))
    assert packages.installed_definitions([package]) == [
        ("share/a_msgs", ["a_msgs/package.xml", "a_msgs/CMakeLists.txt"]),
        ("share/a_msgs/msg", ["a_msgs/msg/Thing.msg"]),
    ]


def test_changed_definition_makes_package_and_dependents_stale(tmp_path: Path) -> None:
    write_package(tmp_path, "a_msgs")
    write_package(tmp_path, "b_msgs", depends=("a_msgs",))
    write_package(tmp_path, "c_msgs")
    before = keys(tmp_path)
    (tmp_path / "a_msgs" / "msg" / "Thing.msg").write_text("uint16 a\n")
    after = keys(tmp_path)
    assert {name for name in before if before[name] != after[name]} == {"a_msgs", "b_msgs"}


def test_changed_tool_makes_all_packages_stale(tmp_path: Path, versions: dict[str, str]) -> None:
    write_package(tmp_path, "a_msgs")
    before = keys(tmp_path)
    assert keys(tmp_path) == before
    assert keys(tmp_path, replace(TOOLS, optimization="-O2")) != before
    versions["ros-rosidl-generator-py"] = "2.0"
    assert keys(tmp_path) != before


def test_all_missing_tools_are_named_with_their_packages(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("CC", "no-such-gcc")
    monkeypatch.setenv("CXX", "no-such-g++ -std=c++20")
    monkeypatch.setattr(toolchain.sysconfig, "get_paths", lambda: {"include": str(tmp_path)})
    with pytest.raises(SystemExit) as exit_info:
        toolchain.find_toolchain()
    message = str(exit_info.value)
    assert "no-such-gcc: not found; sudo apt install gcc\n" in message
    assert "no-such-g++ -std=c++20: not found; sudo apt install g++\n" in message
    assert f"Python.h: not found; sudo apt install python{sys.version_info.major}.{sys.version_info.minor}-dev" in message


def test_build_without_isolation_names_packages_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rosidl_generator_c", None)
    with pytest.raises(SystemExit, match=r"build with isolation.*pip install ros-jazzy-common-interfaces"):
        toolchain.ros_wheels_prefix()
