"""`probe`: a question whose answer later steps' conditions look at. It changes nothing."""

from __future__ import annotations

from typing import Any, ClassVar

from lupin_cli.operations.base import Difference, OperationError
from lupin_cli.operations.shell import look
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Target


@dataclass(frozen=True, kw_only=True)
class Probe:
    """`status` and `stdout` (without the last line break) of a script; `number` where it printed one."""

    name: ClassVar[str] = "probe"
    stands: ClassVar[bool] = True
    read_only: ClassVar[bool] = True
    reports: ClassVar[tuple[str, ...]] = ("status", "stdout", "number")

    run: str
    root: bool = False
    timeout_s: float = 5.0
    machine: str = "robot"

    def differs(self, target: Target) -> Difference | None:
        return None

    def change(self, target: Target, difference: Difference) -> None:
        raise AssertionError("a probe never differs")

    def undo(self, target: Target, before: dict[str, Any]) -> None:
        raise AssertionError("a probe never differs")

    def report(self, target: Target) -> dict[str, Any]:
        output = look(target, self.run, root=self.root, bound_s=self.timeout_s)
        if output.truncated:
            first = self.run.strip().splitlines()[0]
            raise OperationError(f"{first!r} on {target.name} printed more than {len(output.stdout)} characters: ask for less")
        text = output.stdout.rstrip("\n")
        try:
            number: float | None = float(text)
        except ValueError:
            number = None
        return {"status": output.status, "stdout": text, "number": number}
