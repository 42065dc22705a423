"""`require`: a condition that must hold; otherwise the run stops with a reason."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from lupin_cli.connection.base import Output
from lupin_cli.operations.base import Difference, Operation, OperationError


@dataclass(frozen=True, kw_only=True)
class Require(Operation):
    """`holds` is a condition in {{ }}. If it is false, `otherwise` says what is wrong and `next` what to type."""

    name: ClassVar[str] = "require"
    read_only: ClassVar[bool] = True  # a run that begins at a later step needs what it protects, too
    guards: ClassVar[bool] = True
    effect: ClassVar[str] = "read only: a condition holds, or the run stops here with a reason"

    holds: Any
    otherwise: str
    next: str = ""

    def probe(self) -> None:
        """Return None: the condition uses the results of earlier steps."""

    def judge(self, output: Output) -> Difference | None:
        if not self.holds:
            raise OperationError(self.otherwise, self.next)
        return None
