"""`require`: something that must hold, or the playbook ends here with a reason."""

from __future__ import annotations

from typing import Any, ClassVar

from lupin_cli.operations.base import Difference, OperationError
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Target


@dataclass(frozen=True, kw_only=True)
class Require:
    """`holds` is a condition in {{ }}; `otherwise` says what is wrong where it doesn't, `next` what to type."""

    name: ClassVar[str] = "require"

    holds: Any
    otherwise: str
    next: str = ""
    machine: str = "robot"

    def differs(self, target: Target) -> Difference | None:
        if not self.holds:
            raise OperationError(self.otherwise, self.next)
        return None

    def change(self, target: Target, difference: Difference) -> None:
        raise AssertionError("a requirement never differs")

    def undo(self, target: Target, before: dict[str, Any]) -> None:
        raise AssertionError("a requirement never differs")
