"""A check, the snapshot it judges, and the findings it returns."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Literal, TypeVar

from lupin_cli.facts.base import Fact, Facts
from lupin_cli.facts.link import Link
from lupin_cli.link.path import Path

Value = TypeVar("Value")


class Severity(str, Enum):
    """A problem keeps the robot from working now; a warning is about something that will later."""

    PROBLEM = "problem"
    WARNING = "warning"


@dataclass(frozen=True)
class Fix:
    """What removes a finding's cause: a command, what a person does by hand, and the playbook that `--fix` plays."""

    command: str = ""  # a line for a shell of the laptop, never prose; empty: there is only something to do by hand
    playbook: str = ""  # empty: only a person can do it
    variables: dict[str, Any] = field(default_factory=dict)  # of the playbook
    safe: bool = False  # `--fix` plays it without asking: it stops nothing that works and loses no data
    instruction: str = ""  # what a person does by hand, or must know before the command is typed; may be empty


@dataclass(frozen=True)
class Finding:
    """One problem: what the operator sees, its cause, the lines that show it, and its fix."""

    id: str  # kebab-case and stable: scripts and `explains` refer to it
    severity: Severity
    where: str  # "robot", "laptop" or "link"
    symptom: str  # what the operator sees
    cause: str
    evidence: tuple[str, ...]  # lines as the machine printed them
    fix: Fix
    # Findings that disappear together with this one: an id, or `id:about` for a single subject.
    explains: frozenset[str] = frozenset()
    about: str = ""  # the subject, if one id can occur several times: a topic, a machine
    blocks_playbooks: frozenset[str] = frozenset()  # playbooks that fail on this machine until this finding is fixed
    graph: str = ""  # the ROS graph on which it was observed, if it was: a machine may have several
    layer: str = "samples"  # of `lupin_cli.checks.layers`: where on the path the fault is

    def accounts_for(self, other: Finding) -> bool:
        """Return whether `other` is a consequence of this finding. A finding of one graph explains none of another."""
        if self.graph and other.graph and self.graph != other.graph:
            return False
        return bool(self.explains & {other.id, f"{other.id}:{other.about}"}) and other.id != self.id


@dataclass(frozen=True)
class Gap:
    """What was not observed: a fact of a machine, or what a check or plug-in that failed would have found."""

    kind: Literal["fact", "check", "plug-in"]
    name: str
    reason: str
    machine: str = ""  # of a fact

    def __str__(self) -> str:
        """Return the gap in one line."""
        return f"{self.machine or self.kind}{': ' if self.machine else ' '}{self.name}: {self.reason}"


@dataclass(frozen=True)
class Snapshot:
    """The input of every check: the facts of both machines and the link between them, at one time."""

    laptop: Facts
    robot: Facts | None  # None if no robot was selected, or it was not reached
    link: Link | None = None  # None if no robot was selected
    path: Path | None = None  # None if it was not measured: this machine receives what it should

    @property
    def machines(self) -> tuple[Facts, ...]:
        """The facts of the laptop and, if it was reached, of the robot."""
        return (self.laptop,) if self.robot is None else (self.laptop, self.robot)

    def robot_fact(self, fact: Fact[Value]) -> Value | None:
        """Return the value of a fact of the robot; None if the robot was not reached or the fact is unknown."""
        return None if self.robot is None else self.robot.get(fact)


@dataclass(frozen=True)
class Check:
    """A pure function from a snapshot to findings, with the facts that it needs of each machine.

    `followup_*` are facts that are too expensive to gather every time. The doctor gathers them if this check returned a
    finding, and then runs all checks again.
    """

    name: str
    find: Callable[[Snapshot], Iterable[Finding]]
    laptop: tuple[Fact[Any], ...] = ()
    robot: tuple[Fact[Any], ...] = ()
    followup_laptop: tuple[Fact[Any], ...] = ()
    followup_robot: tuple[Fact[Any], ...] = ()
