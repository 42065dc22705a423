"""`probe`: a read-only script whose output the conditions of later steps use."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from lupin_cli.connection.base import Output, Script
from lupin_cli.operations.base import Difference, Operation, OperationError, probe_script


@dataclass(frozen=True, kw_only=True)
class Probe(Operation):
    """Reports the script's `status`, its `stdout` without trailing line breaks, and the `number` that it printed, if any."""

    name: ClassVar[str] = "probe"
    effect: ClassVar[str] = "read only: a script's `status`, `stdout` and `number`"
    prefetchable: ClassVar[bool] = True
    read_only: ClassVar[bool] = True
    result_keys: ClassVar[tuple[str, ...]] = ("status", "stdout", "number")

    run: str
    root: bool = False
    timeout_s: float = 5.0

    def probe(self) -> Script:
        return probe_script(self.run, root=self.root, timeout_s=self.timeout_s)

    def judge(self, output: Output) -> Difference | None:
        return None

    def report(self, output: Output) -> dict[str, Any]:
        if output.truncated:
            first = (self.run.strip() or "nothing").splitlines()[0]
            raise OperationError(f"{first!r} printed more than {len(output.stdout)} characters; let it print less")
        text = output.stdout.rstrip("\n")
        try:
            number: float | None = float(text)
        except ValueError:
            number = None
        return {"status": output.status, "stdout": text, "number": number}
