"""Which graphs this machine has to do with: those of its live runs, and the robot's."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass

from lupin_runtime.stack.dds import FOREIGN, NoRobotEnvironment, robot_environment
from lupin_runtime.stack.runs import live_runs

IDENTITY = ("ROS_DOMAIN_ID", "ROS_DISCOVERY_SERVER", "FASTRTPS_DEFAULT_PROFILES_FILE")


@dataclass(frozen=True)
class KnownGraph:
    """A graph and the whole environment in which a process joins it."""

    name: str  # a run's id, or `robot`
    kind: str  # sim or robot
    environment: Mapping[str, str]

    @property
    def identity(self) -> tuple[str, ...]:
        """What tells it from other graphs."""
        return tuple(self.environment.get(key, "") for key in IDENTITY)


def known_graphs(base: Mapping[str, str] | None = None) -> tuple[KnownGraph, ...]:
    """Every live run's graph, then the robot's where `ros-env.sh` or the shell names one; each once."""
    base = dict(os.environ if base is None else base)
    found = []
    for run in live_runs():
        info = run.info()
        if info.get("environment"):
            # A run on loopback is left by anything that points elsewhere.
            own = {key: value for key, value in base.items() if key not in FOREIGN and key not in IDENTITY}
            kind = info.get("options", {}).get("target", "sim")
            found.append(KnownGraph(run.id, kind, own | info["environment"]))
    try:
        environment, _ = robot_environment(base)
    except NoRobotEnvironment:
        pass  # the doctor of DDS settings says so; here it only means that there is no such graph
    else:
        found.append(KnownGraph("robot", "robot", environment))
    return tuple({graph.identity: graph for graph in reversed(found)}.values())[::-1]
