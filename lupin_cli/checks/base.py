"""A check and what it finds."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import field
from enum import Enum
from typing import Any

from lupin_cli.facts.base import Fact, Facts
from lupin_cli.quick_dataclass import dataclass


class Severity(str, Enum):
    """A problem keeps the robot from its work; a warning will, some day."""

    PROBLEM = "problem"
    WARNING = "warning"


@dataclass(frozen=True)
class Fix:
    """What mends a finding. `command` is what a person types; `playbook` with `variables` is what `--fix` plays."""

    command: str
    playbook: str = ""  # empty: only a person can do it
    variables: dict[str, Any] = field(default_factory=dict)
    safe: bool = False  # may be done unasked: stops nothing that works and loses nothing


@dataclass(frozen=True)
class Finding:
    """One cause, with what shows it."""

    id: str  # kebab-case, stable: scripts and `explains` name it
    severity: Severity
    where: str  # "robot", "laptop" or "link"
    symptom: str  # what a person sees
    cause: str
    evidence: tuple[str, ...]  # the lines that show it, as the machine printed them
    fix: Fix
    # What goes away with this one: ids of findings, or `id:about` where only that one does.
    explains: frozenset[str] = frozenset()
    about: str = ""  # what it is about, where there may be several of one id: a topic, a machine
    hinders: frozenset[str] = frozenset()  # playbooks that can't succeed on its machine while it stands: none is safe then

    def accounts_for(self, other: Finding) -> bool:
        """Whether `other` goes away with this one."""
        return bool(self.explains & {other.id, f"{other.id}:{other.about}"}) and other.id != self.id


@dataclass(frozen=True)
class Evidence:
    """What checks look at: both machines, and how the robot could (not) be reached."""

    laptop: Facts
    robot: Facts | None  # None where no robot was asked for or reached
    link: Any = None  # what is known of the way between them


@dataclass(frozen=True)
class Check:
    """A pure function from evidence to findings, with the facts it needs.

    `closer_*` are facts that cost too much to be asked for every time: they are asked for where the check found something, and
    then all checks judge anew.
    """

    name: str
    find: Callable[[Evidence], Iterable[Finding]]
    laptop: tuple[Fact[Any], ...] = ()
    robot: tuple[Fact[Any], ...] = ()
    closer_laptop: tuple[Fact[Any], ...] = ()
    closer_robot: tuple[Fact[Any], ...] = ()
