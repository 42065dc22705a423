"""The options of one run of the stack, and its targets: the sets of processes that may run together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from lupin_runtime.ports import CONSOLE_PORT, ROSBRIDGE_PORT

SIM = "sim"
ROBOT = "robot"  # the robot's processes run there already; `lupin up --target robot` starts those on the laptop
ONBOARD = "onboard"  # the processes on the robot
ROBOT_CAMERAS = "cameras"  # the robot's camera service
LAPTOP_TARGETS = (SIM, ROBOT)  # of `lupin up`
ALL_TAGS = 65535  # discovery goal "all": the largest count that fits into StartMission

_STORED_AS = {"navigation": "nav2", "flowers": "yolo", "console": "web", "monitoring_rounds": "sweeps"}
_PATHS = ("map_file", "approach_overrides", "layout")


@dataclass(frozen=True)
class Options:
    """The options of one `lupin up`. The defaults are those of a simulated run without a mission."""

    target: str = SIM
    world: str = "demo"
    seed: int = 0
    speed: float = 1.0
    cameras: bool = True
    slam: bool = True
    navigation: bool = True
    twin: bool = True
    perception: bool = True
    flowers: bool = True
    mission: bool = False
    record: bool = True
    console: bool = False
    port: int = CONSOLE_PORT  # of the console's page
    rosbridge_port: int = ROSBRIDGE_PORT  # 0: any free one
    video: bool = True  # serve the simulated cameras to the console
    estop_button: bool = True  # the robot has one, without which the e-stop's process does not say that it is released
    foxglove: bool = False
    joystick: bool = True  # drive with a gamepad of the computer that runs it
    rviz: bool = False
    map_file: Path | None = None
    initial_pose: tuple[float, float, float] | None = None  # on the map: x m, y m, yaw rad
    discovery_goal: int = 5
    monitoring_rounds: int = 0  # 0 repeats them forever
    dependency_timeout_s: float = 120.0
    approach_overrides: Path | None = None
    layout: Path | None = None
    system_engines: tuple[str, ...] = ()  # flags of rows whose work programs of the ROS distribution do
    run_path: Path = Path()

    @property
    def simulated(self) -> bool:
        """Whether the robot is the simulator."""
        return self.target == SIM

    def as_json(self) -> dict[str, Any]:
        """Return the options as stored in `run.json` and `report.json`, in which some have the names of their flags."""
        plain = {_STORED_AS.get(key, key): value for key, value in vars(self).items()}
        return {key: str(value) if isinstance(value, Path) else value for key, value in plain.items()}

    @classmethod
    def from_json(cls, stored: Mapping[str, Any]) -> Options:
        """Return the options that `as_json` stored. One that is missing, or of another type, has its default."""
        found: dict[str, Any] = {}
        for name, default in vars(cls()).items():
            value = stored.get(_STORED_AS.get(name, name))
            if name in _PATHS:
                found[name] = Path(value) if isinstance(value, str) else None
            elif name == "initial_pose":
                if isinstance(value, list) and [type(each) for each in value] == [float] * 3:
                    found[name] = tuple(value)
            elif name == "system_engines":
                if isinstance(value, list):
                    found[name] = tuple(each for each in value if isinstance(each, str))
            elif type(value) is type(default) and name != "run_path":
                found[name] = value
        return cls(**found)

    def in_folder(self, path: Path) -> Options:
        """Return a copy for the run with the directory `path`."""
        return replace(self, run_path=path)
