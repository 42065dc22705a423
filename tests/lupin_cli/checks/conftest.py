"""Captured facts of a healthy laptop and robot, changed by tests, under all network checks at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import pytest

from lupin_cli.checks import Finding, Snapshot
from lupin_cli.checks.dds_environment import CHECKS as DDS_ENVIRONMENT
from lupin_cli.checks.discovery import CHECKS as DISCOVERY
from lupin_cli.checks.link import CHECKS as LINK
from lupin_cli.checks.multihoming import CHECKS as MULTIHOMING
from lupin_cli.checks.own_networks import CHECKS as OWN_NETWORKS
from lupin_cli.checks.ports import CHECKS as PORTS
from lupin_cli.checks.profiles import CHECKS as PROFILES
from lupin_cli.checks.services import CHECKS as SERVICES
from lupin_cli.checks.shell_environment import CHECKS as SHELL_ENVIRONMENT
from lupin_cli.checks.stale_resources import CHECKS as STALE_RESOURCES
from lupin_cli.checks.unit_environment import CHECKS as UNIT_ENVIRONMENT
from lupin_cli.checks.wifi import CHECKS as WIFI
from lupin_cli.doctor.engine import diagnose
from lupin_cli.facts import Facts
from lupin_cli.facts.link import Link
from tests.support.findings import assert_findings_match_rows
from tests.support.snapshots import HEALTHY_LAPTOP, HEALTHY_ROBOT, captured

CHECKS = (
    *LINK,
    *WIFI,
    *OWN_NETWORKS,
    *DISCOVERY,
    *MULTIHOMING,
    *DDS_ENVIRONMENT,
    *SHELL_ENVIRONMENT,
    *PROFILES,
    *STALE_RESOURCES,
    *PORTS,
    *UNIT_ENVIRONMENT,
    *SERVICES,
)


@dataclass(frozen=True)
class Machines:
    """The facts of a laptop and a robot, and the link between them. `with_laptop` and `with_robot` change one fact."""

    laptop: Mapping[str, Any]
    robot: Mapping[str, Any] | None
    link: Link | None

    def with_laptop(self, fact: str, value: Any) -> Machines:
        """Return a copy with one fact of the laptop changed: to a captured case, by a function of its value, or to a value."""
        return replace(self, laptop=_with_fact(self.laptop, fact, value))

    def with_robot(self, fact: str, value: Any) -> Machines:
        """Do the same for one fact of the robot."""
        assert self.robot is not None
        return replace(self, robot=_with_fact(self.robot, fact, value))

    def unreachable(self, kind: str) -> Machines:
        """Return a copy in which the robot could not be reached."""
        assert self.link is not None
        return replace(self, robot=None, link=replace(self.link, kind=kind, message=f"mirte@10.42.0.1: {kind}"))

    @property
    def snapshot(self) -> Snapshot:
        """The input of the checks."""
        robot = None if self.robot is None else Facts("robot", self.robot)
        return Snapshot(Facts("laptop", self.laptop), robot, self.link)

    def root_findings(self) -> list[Finding]:
        """Return the root causes that the checks find."""
        diagnosis = diagnose(CHECKS, self.snapshot)
        assert_findings_match_rows(diagnosis)
        return [root.finding for root in diagnosis.roots]

    def root_ids(self) -> list[str]:
        """Return the ids of the root causes."""
        return [finding.id for finding in self.root_findings()]


def _with_fact(values: Mapping[str, Any], fact: str, value: Any) -> Mapping[str, Any]:
    if isinstance(value, str):
        value = captured(fact, value)
    elif callable(value):
        value = value(values[fact])
    return {**values, fact: value}


@pytest.fixture(scope="session")
def healthy() -> Machines:
    """Return a deployed robot on the cable and a configured laptop, without any fault."""
    laptop = {fact: captured(fact, case) for fact, case in HEALTHY_LAPTOP.items()}
    processes = captured("ros-processes", "laptop-with-a-multicast-node")
    laptop["ros-processes"] = tuple(process for process in processes if process.server)
    return Machines(laptop, {fact: captured(fact, case) for fact, case in HEALTHY_ROBOT.items()}, Link("mirte", "10.42.0.1"))


@pytest.fixture(scope="session")
def capture() -> Callable[[str, str], Any]:
    return captured
