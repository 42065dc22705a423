"""Every interface folder builds with both pip and colcon: package.xml, CMakeLists.txt and the definitions agree."""

from __future__ import annotations

import importlib
import re
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.support.paths import INTERFACES
from tests.support.rosidl_build import load_rosidl_build

packages = load_rosidl_build("packages")
PACKAGES = packages.discover(INTERFACES)
EXPECTED = {
    "lupin_msgs",
    "mirte_msgs",
    "tf2_msgs",
    "nav2_msgs",
    "geographic_msgs",
    "control_msgs",
    "controller_manager_msgs",
    "slam_toolbox",
    "rosapi_msgs",
}

each_package = pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.name)


def test_interfaces_contains_the_expected_packages() -> None:
    assert {package.name for package in PACKAGES} == EXPECTED


@each_package
def test_cmake_lists_all_definitions(package: Any) -> None:
    listed = re.findall(r"^\s+(\w+/\w+\.\w+)$", (package.folder / "CMakeLists.txt").read_text(), re.MULTILINE)
    assert listed == [str(definition) for definition in package.definitions]


@each_package
def test_package_xml_and_cmake_list_all_dependencies(package: Any) -> None:
    used = packages.referenced_packages(package)
    if any(definition.parts[0] == "action" for definition in package.definitions):
        used.add("action_msgs")  # for the hidden services and topics of every action
    cmake = (package.folder / "CMakeLists.txt").read_text()
    dependencies = re.search(r"DEPENDENCIES (.*)", cmake)
    assert package.depends == used
    assert set(dependencies[1].split() if dependencies else ()) == used
    assert {name for name in re.findall(r"find_package\((\w+)", cmake) if name in used} == used


@each_package
def test_definitions_can_be_imported_with_type_support(package: Any) -> None:
    for definition in package.definitions:
        module = importlib.import_module(f"{package.name}.{definition.parts[0]}")
        interface = getattr(module, definition.stem)
        type(interface).__import_type_support__()
        assert type(interface)._TYPE_SUPPORT is not None, definition


@each_package
def test_installed_definitions_are_current(package: Any) -> None:
    """If this fails, a definition has been changed but not installed: ``pip install ./interfaces``."""
    share = Path(sys.prefix) / "share" / package.name
    for definition in package.definitions:
        assert (share / definition).read_text() == (package.folder / definition).read_text(), definition
