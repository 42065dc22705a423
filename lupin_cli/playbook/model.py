"""The playbook language as data. Everything in a playbook is checked before anything runs.

name: recover-discovery            # the file's name
description: One sentence.
exclusive: true                    # it takes the robot's lease before it changes the robot; so do playbooks that include it
vars:
  port: 11811                      # the type is the default's, or:
  laptop: {type: address, default: 10.42.0.2, help: The laptop's address.}
  key: {type: secret}              # without a default it must be given: --hidden key
steps:
  - name: Start the server
    discovery-server: {port: "{{ port }}"}   # one operation and its arguments
    on: robot                      # robot (the default) or laptop
    as: server                     # the result's name in later conditions: server.changed
    when: not listener.present     # a condition on variables and earlier results
    until: server.status == 0      # the probe runs again until this holds, within the timeout
    retry: {times: 2, pause_s: 3}  # a failed step is tried again
    timeout: 30                    # seconds for the whole step
    confirm: This ends the session.
    undo: false                    # --undo leaves this step's change
    always: true                   # runs even after a failed step, so that nothing stays stopped
    tags: [server, network]        # --tag plays only the steps with one of the given tags
  - include: sweep
    vars: {dry: false}
    when: server.changed
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lupin_cli.operations.base import Operation
from lupin_cli.package_data import shipped_folder
from lupin_cli.playbook.expressions import Expression
from lupin_cli.playbook.yaml_source import Place

MACHINES = ("robot", "laptop")
DEFAULT_TIMEOUT_S = 60.0
BUILTINS: dict[str, tuple[str, ...]] = {"robot": ("name", "user", "address", "login"), "laptop": ("name", "user", "home")}
RESULT_VALUES = ("changed", "skipped")  # of every step's result; operations add their `report_keys`


@dataclass(frozen=True)
class Variable:
    """A value that the operator or the including playbook gives."""

    name: str
    type: str
    place: Place
    default: Any = None  # may hold templates over the variables above it
    has_default: bool = False
    choices: tuple[Any, ...] = ()
    help: str = ""


@dataclass(frozen=True)
class Retry:
    """How often a failed step is tried again, and the pause before each attempt."""

    times: int = 0
    pause_s: float = 2.0


@dataclass(frozen=True)
class PlaybookFrame:
    """The names that the steps of one file see. An included file has its own names; the including step gives their values."""

    variables: tuple[Variable, ...]
    given: Mapping[str, tuple[Any, Place]] = field(default_factory=dict)  # templates over the parent's names
    parent: PlaybookFrame | None = None
    when: Expression | None = None  # of the including step, over the parent's names
    when_place: Place | None = None


@dataclass(frozen=True)
class Step:
    """One operation with its arguments: when it runs, for how long and how often."""

    name: str
    place: Place
    operation: type[Operation]
    arguments: Mapping[str, tuple[Any, Place]]  # values and templates, with their places
    frame: PlaybookFrame
    machine: str = "robot"
    result: str = ""
    when: Expression | None = None
    until: Expression | None = None
    retry: Retry = Retry()
    timeout_s: float = DEFAULT_TIMEOUT_S
    confirm: Any = None
    undo: bool = True
    always: bool = False
    tags: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Playbook:
    """A playbook with the steps of all that it includes."""

    name: str
    description: str
    file: str
    variables: tuple[Variable, ...]
    steps: tuple[Step, ...]
    digest: str  # of the text of all its files: a run is resumed only with the same text
    exclusive: bool = False  # it takes the robot's lease

    @property
    def typed_name(self) -> str:
        """What a person types to name it: the name of a shipped playbook, the file of another."""
        return self.name if Path(self.file).parent == shipped_folder("playbooks") else self.file

    @property
    def tags(self) -> frozenset[str]:
        """The tags of its steps."""
        return frozenset().union(*(step.tags for step in self.steps))

    @property
    def machines(self) -> frozenset[str]:
        """The machines that its steps run on."""
        return frozenset(step.machine for step in self.steps)
