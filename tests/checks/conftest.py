"""Machines as they were captured, healthy and sick, and all network checks at once: a fault must be named and nothing else."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.checks import Evidence, Finding
from lupin_cli.checks.discovery import CHECKS as DISCOVERY
from lupin_cli.checks.environment import CHECKS as ENVIRONMENT
from lupin_cli.checks.homing import CHECKS as HOMING
from lupin_cli.checks.leftovers import CHECKS as LEFTOVERS
from lupin_cli.checks.link import CHECKS as LINK
from lupin_cli.checks.ports import CHECKS as PORTS
from lupin_cli.checks.profiles import CHECKS as PROFILES
from lupin_cli.diagnosis import diagnose, facts_of
from lupin_cli.facts import Facts
from lupin_cli.facts.link import Link
from lupin_cli.target import Output

CHECKS = (*LINK, *DISCOVERY, *HOMING, *ENVIRONMENT, *PROFILES, *LEFTOVERS, *PORTS)
CAPTURED = Path(__file__).parents[1] / "facts" / "captured"
FACTS = {fact.name: fact for machine in ("laptop", "robot") for fact in facts_of(CHECKS, machine)}

_LAPTOP = {
    "addresses": "laptop-with-a-multicast-node",
    "routes": "laptop-with-a-multicast-node",
    "sockets": "laptop-with-a-multicast-node",
    "shell": "laptop-with-a-multicast-node",
    "dds-profiles": "laptop-with-a-multicast-node",
    "shared-memory": "laptop-with-a-multicast-node",
    "network-manager": "no-network-manager",
}
_ROBOT = {
    "addresses": "healthy-robot",
    "sockets": "healthy-robot",
    "ros-processes": "healthy-robot",
    "dds-profiles": "healthy-robot",
    "shared-memory": "healthy-robot",
    "discovery-log": "server-came-up",
}


def captured(fact: str, case: str) -> Any:
    """The value of a captured output."""
    return FACTS[fact].parse(Output(0, (CAPTURED / fact / f"{case}.txt").read_text()))


@dataclass(frozen=True)
class World:
    """A laptop, a robot and the way between them; `with_` makes it sick."""

    laptop: Mapping[str, Any]
    robot: Mapping[str, Any] | None
    link: Link | None

    def with_(self, machine: str, fact: str, value: Any) -> World:
        """The same world but for one fact: a captured case's name, or a function of the healthy value."""
        values = dict(getattr(self, machine))
        if isinstance(value, str):
            values[fact] = captured(fact, value)
        else:
            values[fact] = value(values[fact]) if callable(value) else value
        return replace(self, **{machine: values})

    def unreachable(self, kind: str) -> World:
        """The same laptop, and no answer from the robot."""
        assert self.link is not None
        return replace(self, robot=None, link=replace(self.link, kind=kind, message=f"mirte@10.42.0.1: {kind}"))

    @property
    def evidence(self) -> Evidence:
        """What the checks look at."""
        robot = None if self.robot is None else Facts("robot", self.robot)
        return Evidence(Facts("laptop", self.laptop), robot, self.link)

    def roots(self) -> list[Finding]:
        """The causes that are named."""
        diagnosis = diagnose(CHECKS, self.evidence)
        assert diagnosis.broken == ()
        return [root.finding for root in diagnosis.roots]

    def named(self) -> list[str]:
        """Their names."""
        return [finding.id for finding in self.roots()]


@pytest.fixture(scope="session")
def healthy() -> World:
    """A deployed robot on the cable and a laptop that is set up: nothing to find."""
    laptop = {fact: captured(fact, case) for fact, case in _LAPTOP.items()}
    processes = captured("ros-processes", "laptop-with-a-multicast-node")
    laptop["ros-processes"] = tuple(process for process in processes if process.server)
    return World(laptop, {fact: captured(fact, case) for fact, case in _ROBOT.items()}, Link("mirte", "10.42.0.1"))


@pytest.fixture(scope="session")
def capture() -> Callable[[str, str], Any]:
    return captured
