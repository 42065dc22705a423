"""Programs of a ROS distribution that can do the work of a row of the stack, behind the same names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from lupin_runtime.ament import DISTRIBUTION, SYSTEM_PREFIX, find_package


@dataclass(frozen=True)
class Program:
    """An executable of a ROS package, and the managed node in it."""

    package: str
    executable: str
    node: str

    def __str__(self) -> str:
        return f"{self.package}/{self.executable}/{self.node}"


@dataclass(frozen=True)
class Engine:
    """Programs that belong together, the version whose interfaces Lupin has, and the Debian package that installs them."""

    title: str
    version: str
    debian_package: str
    programs: tuple[Program, ...]


def _server(package: str, executable: str) -> Program:
    return Program(package, executable, executable)  # Nav2's executables and nodes have the same names


# In the order in which their nodes become active: bt_navigator accepts goals once what it uses is there.
NAV2 = Engine(
    "Nav2",
    "1.3",
    f"ros-{DISTRIBUTION}-navigation2",
    (
        _server("nav2_controller", "controller_server"),
        _server("nav2_planner", "planner_server"),
        _server("nav2_behaviors", "behavior_server"),
        _server("nav2_bt_navigator", "bt_navigator"),
        _server("nav2_waypoint_follower", "waypoint_follower"),
    ),
)
SLAM_TOOLBOX = Engine(
    "slam_toolbox",
    "2.8",
    f"ros-{DISTRIBUTION}-slam-toolbox",
    (Program("slam_toolbox", "async_slam_toolbox_node", "slam_toolbox"),),
)


def find_problem(engine: Engine, environment: Mapping[str, str]) -> str:
    """Return why an engine cannot run in this environment, with what to do; empty if it can."""
    for program in engine.programs:
        package = find_package(program.package, environment)
        if package is None or not package.command(program.executable):
            return (
                f"{engine.title} is not installed: there is no {program.executable} of {program.package} in AMENT_PREFIX_PATH "
                f"or {SYSTEM_PREFIX}; install it with: sudo apt-get install {engine.debian_package}"
            )
        if package.version.split(".")[:2] != engine.version.split("."):
            return (
                f"{program.package} in {package.prefix} has version {package.version or 'unknown'}, expected {engine.version}, "
                f"whose interfaces Lupin has; use a terminal that has sourced no ROS distribution other than {DISTRIBUTION}"
            )
    return ""


def describe(engine: Engine, environment: Mapping[str, str]) -> str:
    """Return the engine's name, and which installation it is of, such as `Nav2 1.3.7 in /opt/ros/jazzy`."""
    package = find_package(engine.programs[0].package, environment)
    return f"{engine.title} {package.version} in {package.prefix}" if package is not None else engine.title
