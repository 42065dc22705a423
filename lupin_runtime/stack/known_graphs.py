"""The graphs that this machine can join: those of its live runs, and the robot's."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass

from lupin_runtime.stack.dds import FOREIGN, NoRobotEnvironment, robot_environment
from lupin_runtime.stack.runs import live_runs

IDENTITY = ("ROS_DOMAIN_ID", "ROS_DISCOVERY_SERVER", "FASTRTPS_DEFAULT_PROFILES_FILE")
# Two environments that differ in one of these may join different graphs, or the same one with another result.
_SIGNIFICANT = (*IDENTITY, "RMW_IMPLEMENTATION", *FOREIGN)


@dataclass(frozen=True)
class KnownGraph:
    """A graph, and the complete environment in which a process joins it."""

    name: str  # a run's id, `robot` or `shell`
    kind: str  # sim, robot or shell
    environment: Mapping[str, str]

    @property
    def identity(self) -> tuple[str, ...]:
        """The variables that distinguish this graph from others."""
        return tuple(self.environment.get(key, "") for key in IDENTITY)


def known_graphs(base: Mapping[str, str] | None = None, *, with_shell: bool = False) -> tuple[KnownGraph, ...]:
    """Return the graph of every live run, then the robot's if `ros-env.sh` or the shell names it, without duplicates.

    `with_shell` adds the graph that programs started in this shell join, unless its variables equal those of another one.
    """
    base = dict(os.environ if base is None else base)
    found = []
    for run in live_runs():
        info = run.info()
        if info.get("environment"):
            # Variables of another graph would take the process out of this run's.
            own = {key: value for key, value in base.items() if key not in FOREIGN and key not in IDENTITY}
            kind = info.get("options", {}).get("target", "sim")
            found.append(KnownGraph(run.id, kind, own | info["environment"]))
    try:
        environment, _ = robot_environment(base)
    except NoRobotEnvironment:
        pass  # reported by the checks of the DDS set-up; here it means that no robot graph is known
    else:
        found.append(KnownGraph("robot", "robot", environment))
    distinct = tuple({graph.identity: graph for graph in reversed(found)}.values())[::-1]
    shell = KnownGraph("shell", "shell", base)
    if with_shell and all(_significant(known.environment) != _significant(base) for known in distinct):
        return (*distinct, shell)
    return distinct


def _significant(environment: Mapping[str, str]) -> tuple[str, ...]:
    return tuple(environment.get(name, "") for name in _SIGNIFICANT)
