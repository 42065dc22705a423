"""The base class of operations: idempotent changes that a playbook's steps name.

Examine first, change only what differs, then examine again::

    output = observe(operation, target)      # lupin_cli.operations.shell: runs operation.probe() on the target
    difference = operation.judge(output)     # pure
    if difference is not None:
        operation.change(target, difference)
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from lupin_cli.connection.base import Output, Script, Target

PROBE_TIMEOUT_S = 10.0


class OperationError(Exception):
    """A target could not be examined or changed. `next_command` is what the operator should type next, or empty."""

    def __init__(self, message: str, next_command: str = "") -> None:
        super().__init__(message)
        self.next_command = next_command


@dataclass(frozen=True)
class Difference:
    """What an operation would change, with the state before."""

    summary: str  # one line, imperative: "create /etc/x"
    diff: str = ""  # a unified diff, or lines that begin with + and -
    before: dict[str, Any] = field(default_factory=dict)  # JSON values that `undo` needs; the journal keeps them


@dataclass(frozen=True)
class RestoredFile:
    """A file or a link that an undo writes or removes, as root or as the target's user."""

    path: str
    root: bool = False


@dataclass(frozen=True, kw_only=True)
class Operation(ABC):
    """A frozen dataclass whose fields are the arguments of a step; `__post_init__` raises ValueError for invalid ones.

    A subclass must define `name`, `effect`, `probe` and `judge`, and usually `change` and `undo`. Everything else has a
    default.
    """

    name: ClassVar[str]  # the word in playbooks, kebab-case
    effect: ClassVar[str]  # for docs/playbooks.md: what is true after the step
    undo_effect: ClassVar[str] = "–"  # for docs/playbooks.md: what --undo does

    prefetchable: ClassVar[bool] = False  # only steps change what it examines, so its probe may run before the step's turn
    read_only: ClassVar[bool] = False  # it only reports, so a run that starts at a later step runs it too
    guards: ClassVar[bool] = False  # it stops a run unless something holds, so a resumed run examines that again
    only_waits: ClassVar[bool] = False  # it waits for what earlier steps cause, so a dry run that would change some skips it
    undo_last: ClassVar[bool] = False  # its undo runs after all others and activates what they restored
    settle_s: ClassVar[float] = 0.0  # how long a difference may remain after `change`; the step's timeout limits it too
    report_keys: ClassVar[tuple[str, ...]] = ()  # the keys of `report`, for the conditions of later steps

    machine: str = "robot"  # where the step runs: "robot" or "laptop"

    @abstractmethod
    def probe(self) -> Script | None:
        """Return the read-only script whose output `judge` needs; None if it needs none, or if `complete` gets all of it."""

    def complete(self, target: Target, output: Output) -> Output:
        """Add to the probe's output what one script cannot fetch, such as a large file. Read-only; raises OperationError."""
        return output

    @abstractmethod
    def judge(self, output: Output) -> Difference | None:
        """Return what differs from the arguments, or None. Pure; raises OperationError for output that it cannot interpret."""

    def change(self, target: Target, difference: Difference) -> None:  # noqa: B027 -- the default does nothing
        """Remove the difference. Raises OperationError."""

    def undo(self, target: Target, before: Mapping[str, Any]) -> None:  # noqa: B027 -- the default does nothing
        """Restore the state `before` a change, even one that was interrupted. Idempotent; raises OperationError."""

    def restored_files(self) -> tuple[RestoredFile, ...]:
        """Return the files that `undo` writes or removes; each is named by its path in `overwritten`."""
        return ()

    def overwritten(self, output: Output) -> dict[str, bytes]:
        """Return the state of all that `undo` overwrites, by a name for a person: it is refused if somebody changed it since.

        Pure; raises OperationError.
        """
        return {}

    def report(self, output: Output) -> dict[str, Any]:
        """Return the JSON values of `report_keys` for later steps' conditions. Pure; raises OperationError."""
        return {}

    def with_baseline(self, before: Mapping[str, Any]) -> Operation:
        """Return an operation that judges changes since `before`, the state when the step began."""
        return self

    def prepare(self) -> None:  # noqa: B027 -- the default does nothing
        """Do slow local work that `complete` and `judge` will need, while the robot answers. Raises OperationError."""

    @property
    def inspect_command(self) -> str:
        """The command that shows an operator why the change did not hold; empty if there is none."""
        return ""


def probe_script(text: str, *, root: bool = False, timeout_s: float = PROBE_TIMEOUT_S) -> Script:
    """Return a probe: a script that reads and changes nothing."""
    return Script("probe", text, timeout_s, root)
