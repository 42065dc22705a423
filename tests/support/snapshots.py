"""Snapshots from captured facts: a healthy laptop and robot, and variants with other captured outputs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lupin_cli.checks import Snapshot
from lupin_cli.checks.table import built_in
from lupin_cli.connection import Output
from lupin_cli.doctor.gathering import needed_facts
from lupin_cli.facts import Facts
from lupin_cli.facts.link import Link
from tests.support.paths import CAPTURED_FACTS

_FOLLOWUPS = (fact for check in built_in() for fact in (*check.followup_laptop, *check.followup_robot))
FACTS = {fact.name: fact for fact in (*needed_facts(built_in(), "laptop"), *needed_facts(built_in(), "robot"), *_FOLLOWUPS)}
# The captured case of each fact, for a configured laptop and a deployed robot on the cable, without any fault.
HEALTHY_LAPTOP = {
    "addresses": "laptop-with-a-multicast-node",
    "routes": "laptop-with-a-multicast-node",
    "sockets": "laptop-with-a-multicast-node",
    "shell": "laptop-with-a-multicast-node",
    "dds-profiles": "laptop-with-a-multicast-node",
    "shared-memory": "laptop-with-a-multicast-node",
    "network-manager": "no-network-manager",
    "unfinished-runs": "none",
    "chrony": "laptop-serving",
    "kernel-clock": "synchronized",
    "storage": "bare-robot",
    "memory": "orange-pi",
}
HEALTHY_ROBOT = {
    "addresses": "healthy-robot",
    "sockets": "healthy-robot",
    "ros-processes": "healthy-robot",
    "dds-profiles": "healthy-robot",
    "shared-memory": "healthy-robot",
    "discovery-log": "server-came-up",
    "units": "healthy",
    "journal": "healthy",
    "chrony": "chrony-follows-laptop",
    "clock": "bare-robot",
    "storage": "bare-robot",
    "memory": "orange-pi",
    "thermal": "orange-pi",
    "devices": "bare-robot",
    "account": "in-all-groups",
    "versions": "deployed-humble",
    "release-files": "undamaged",
}
SECOND_NS = 1_000_000_000


def captured(fact: str, case: str) -> Any:
    """Return the parsed value of a captured output: tests/lupin_cli/facts/captured/FACT/CASE.txt."""
    return FACTS[fact].parse(Output(0, (CAPTURED_FACTS / fact / f"{case}.txt").read_text()))


def values(cases: Mapping[str, Any]) -> dict[str, Any]:
    """Return values by fact: a string in `cases` names a captured case, anything else is the value itself."""
    return {fact: captured(fact, case) if isinstance(case, str) else case for fact, case in cases.items()}


def snapshot_of(laptop: Mapping[str, Any], robot: Mapping[str, Any], ahead_s: float = 0.0) -> Snapshot:
    """Return a snapshot of captured cases or values. The robot's clock is `ahead_s` ahead of the laptop's, ± 0.5 s."""
    robot_values = values(robot)
    epoch_ns = robot_values["clock"].epoch_ns
    probed_ns = tuple(epoch_ns - round((ahead_s + side) * SECOND_NS) for side in (0.5, -0.5))
    return Snapshot(
        Facts("laptop", values(laptop)),
        Facts("robot", robot_values, probed_ns),
        Link("lupin", "10.42.0.1"),
    )
