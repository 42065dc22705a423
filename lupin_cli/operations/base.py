"""What an operation is. A playbook's step names one and gives its arguments; the runner calls it in this order."""

from __future__ import annotations

from dataclasses import field
from typing import Any, ClassVar, Protocol

from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Target


class OperationError(Exception):
    """A change that could not be made or did not hold, and the next command to type."""

    def __init__(self, message: str, next_command: str = "") -> None:
        super().__init__(message)
        self.next_command = next_command


@dataclass(frozen=True)
class Difference:
    """How a machine differs from what is asked of it."""

    summary: str  # one line: what will change
    diff: str = ""  # unified diff of a file, where there is one
    before: dict[str, Any] = field(default_factory=dict)  # JSON-able; what `undo` needs to take the change back


class Operation(Protocol):
    """A frozen dataclass whose fields are the step's arguments. Its __post_init__ raises ValueError for unfit ones.

    Optional, where an operation has use for it:
      settle_s: ClassVar[float]    how long after `change` a difference may remain; the step's time-out ends it too (default 0)
      read_only: ClassVar[bool]    it never differs, only reports: asked also where its step is not reached
      stands: ClassVar[bool]       what it looks at stays as it is until somebody changes it: it may be asked before its turn
      prepare() -> None            work of this machine that the look will need, done while the robot answers; may do nothing
      reports: ClassVar[tuple]     the values of `report(target) -> dict`, read only, for later steps' conditions; JSON-able
      begun(before) -> Operation   the same, knowing what it found before it began; verification and resume ask that
      undo_last: ClassVar[bool]    taken back after all others, since it makes effective what they did
      look_command: property       what a person types to look at it where it would not settle
    """

    name: ClassVar[str]  # as a playbook writes it, kebab-case
    machine: str  # "robot" or "laptop"

    def differs(self, target: Target) -> Difference | None:
        """Read only; None where nothing is to do."""

    def change(self, target: Target, difference: Difference) -> None:
        """Make it so; raises OperationError."""

    def undo(self, target: Target, before: dict[str, Any]) -> None:
        """Take the change back, also one that was cut off half-way; doing it twice is doing it once. Raises OperationError."""
