"""Every interface folder builds with pip and with colcon alike: its three descriptions of itself agree."""

from __future__ import annotations

import importlib
import re
import sys
from pathlib import Path

import pytest

INTERFACES = Path(__file__).resolve().parents[2] / "interfaces"
sys.path.insert(0, str(INTERFACES))

from rosidl_build.packages import InterfacePackage, discover, referenced_packages  # noqa: E402

sys.path.remove(str(INTERFACES))  # its folders would pass for packages where these are not installed

PACKAGES = discover(INTERFACES)
EXPECTED = {
    "lupin_msgs",
    "mirte_msgs",
    "tf2_msgs",
    "nav2_msgs",
    "control_msgs",
    "controller_manager_msgs",
    "slam_toolbox",
    "rosapi_msgs",
}

each_package = pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.name)


def test_the_packages_of_the_graph_are_there() -> None:
    assert {package.name for package in PACKAGES} == EXPECTED


@each_package
def test_cmake_lists_every_definition(package: InterfacePackage) -> None:
    listed = re.findall(r"^\s+(\w+/\w+\.\w+)$", (package.folder / "CMakeLists.txt").read_text(), re.MULTILINE)
    assert listed == [str(definition) for definition in package.definitions]


@each_package
def test_package_xml_and_cmake_name_the_packages_that_definitions_use(package: InterfacePackage) -> None:
    used = referenced_packages(package)
    if any(definition.parts[0] == "action" for definition in package.definitions):
        used.add("action_msgs")  # every action's hidden services and topics
    cmake = (package.folder / "CMakeLists.txt").read_text()
    dependencies = re.search(r"DEPENDENCIES (.*)", cmake)
    assert package.depends == used
    assert set(dependencies[1].split() if dependencies else ()) == used
    assert {name for name in re.findall(r"find_package\((\w+)", cmake) if name in used} == used


@each_package
def test_every_definition_is_importable_with_its_type_support(package: InterfacePackage) -> None:
    for definition in package.definitions:
        module = importlib.import_module(f"{package.name}.{definition.parts[0]}")
        interface = getattr(module, definition.stem)
        type(interface).__import_type_support__()
        assert type(interface)._TYPE_SUPPORT is not None, definition


@each_package
def test_the_installed_package_has_these_definitions(package: InterfacePackage) -> None:
    """Or else it was changed and not installed again: ``pip install ./interfaces``."""
    share = Path(sys.prefix) / "share" / package.name
    for definition in package.definitions:
        assert (share / definition).read_text() == (package.folder / definition).read_text(), definition
