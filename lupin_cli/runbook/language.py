"""What a playbook may say. Everything here is checked before anything runs.

name: recover-discovery            # the file's name
description: One sentence.
exclusive: true                    # takes the robot's lease before it changes the robot; so does whatever includes it
vars:
  port: 11811                      # the type is the default's, or:
  laptop: {type: address, default: 10.42.0.2, help: The laptop's address.}
  key: {type: secret}              # without a default it must be given: -v key=...
steps:
  - name: Start the server
    discovery-server: {port: "{{ port }}"}   # one operation and its arguments
    on: robot                      # robot (the default) or laptop
    as: server                     # names the result for later conditions: server.changed
    when: not listener.present     # a condition of variables and earlier results
    until: server.status == 0      # asked again until it holds, within the time-out
    retry: {times: 2, pause_s: 3}  # tried again where it fails
    timeout: 30                    # seconds for the whole step
    confirm: This ends the session.
    undo: false                    # left as it is by --undo
    always: true                   # done also where a step before it failed: nothing stays half-way down
  - include: sweep
    vars: {dry: false}
    when: server.changed
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import Any

from lupin_cli.quick_dataclass import dataclass
from lupin_cli.runbook.expressions import Expression
from lupin_cli.runbook.source import Place

MACHINES = ("robot", "laptop")
DEFAULT_TIMEOUT_S = 60.0
BUILTINS: dict[str, tuple[str, ...]] = {"robot": ("name", "user", "address"), "laptop": ("name", "user", "home")}
RESULT_VALUES = ("changed", "skipped")  # of every step's result; operations add theirs in `reports`


@dataclass(frozen=True)
class Variable:
    """A value that a run is given."""

    name: str
    type: str
    place: Place
    default: Any = None  # may hold templates over the variables above it
    has_default: bool = False
    choices: tuple[Any, ...] = ()
    help: str = ""


@dataclass(frozen=True)
class Retry:
    times: int = 0
    pause_s: float = 2.0


@dataclass(frozen=True)
class Frame:
    """The names that a file's steps see. An included file has its own, filled by the step that includes it."""

    variables: tuple[Variable, ...]
    given: Mapping[str, tuple[Any, Place]] = field(default_factory=dict)  # templates over the parent's names
    parent: Frame | None = None
    when: Expression | None = None  # of the including step, over the parent's names
    when_place: Place | None = None


@dataclass(frozen=True)
class Step:
    """One operation with its arguments, and when, how long and how often."""

    name: str
    place: Place
    operation: type
    arguments: Mapping[str, tuple[Any, Place]]  # values and templates, with where they stand
    frame: Frame
    machine: str = "robot"
    result: str = ""
    when: Expression | None = None
    until: Expression | None = None
    retry: Retry = Retry()
    timeout_s: float = DEFAULT_TIMEOUT_S
    confirm: Any = None
    undo: bool = True
    always: bool = False


@dataclass(frozen=True)
class Playbook:
    """A whole playbook, includes and all."""

    name: str
    description: str
    file: str
    variables: tuple[Variable, ...]
    steps: tuple[Step, ...]
    digest: str  # of every file it was read from: a run is resumed with the same text only
    exclusive: bool = False  # no other exclusive run changes the robot at the same time

    @property
    def machines(self) -> frozenset[str]:
        """The machines that its steps need."""
        return frozenset(step.machine for step in self.steps)
