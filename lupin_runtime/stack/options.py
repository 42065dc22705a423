"""The options of one run of the stack, and the targets that a run may have."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from lupin_runtime.ports import ROSBRIDGE_PORT

SIM = "sim"
ROBOT = "robot"  # the robot's processes run there already; `lupin up --target robot` starts those on the laptop
ONBOARD = "onboard"  # the processes on the robot
ROBOT_CAMERAS = "cameras"  # the robot's camera service
LAPTOP_TARGETS = (SIM, ROBOT)  # of `lupin up`
ALL_TAGS = 65535  # discovery goal "all": the largest count that fits into StartMission


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
    rosbridge_port: int = ROSBRIDGE_PORT  # 0: any free one
    video: bool = True  # serve the simulated cameras to the console
    foxglove: bool = False
    rviz: bool = False
    map_file: Path | None = None
    initial_pose: tuple[float, float, float] | None = None  # on the map: x m, y m, yaw rad
    discovery_goal: int = 5
    monitoring_rounds: int = 0  # 0 repeats them forever
    dependency_timeout_s: float = 120.0
    approach_overrides: Path | None = None
    layout: Path | None = None
    run_path: Path = Path()

    @property
    def simulated(self) -> bool:
        """Whether the robot is the simulator."""
        return self.target == SIM

    def as_json(self) -> dict[str, Any]:
        """Return the options as stored in `run.json` and `report.json`, in which some have the names of their flags."""
        names = {"navigation": "nav2", "flowers": "yolo", "console": "web", "monitoring_rounds": "sweeps"}
        plain = {names.get(key, key): value for key, value in vars(self).items()}
        return {key: str(value) if isinstance(value, Path) else value for key, value in plain.items()}

    def in_folder(self, path: Path) -> Options:
        """Return a copy for the run with the directory `path`."""
        return replace(self, run_path=path)
