"""`probe`: a read-only script whose output the conditions of later steps use."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from typing import Any, ClassVar

from lupin_cli.connection.base import Output, Script
from lupin_cli.operations.base import Difference, Operation, OperationError, probe_script


@dataclass(frozen=True, kw_only=True)
class Probe(Operation):
    """Reports the script's `status`, its `stdout` without trailing line breaks, and the `number` that it printed, if any.

    Text from elsewhere, such as a network's name, belongs into `arguments`: the script has it as $1, $2, whatever it contains.
    """

    name: ClassVar[str] = "probe"
    effect: ClassVar[str] = "read only: a script's `status`, `stdout` and `number`"
    prefetchable: ClassVar[bool] = True
    read_only: ClassVar[bool] = True
    report_keys: ClassVar[tuple[str, ...]] = ("status", "stdout", "number")

    run: str
    arguments: tuple[str, ...] = ()
    root: bool = False
    timeout_s: float = 5.0

    def probe(self) -> Script:
        script = f"set -- {shlex.join(self.arguments)}\n{self.run}" if self.arguments else self.run
        return probe_script(script, root=self.root, timeout_s=self.timeout_s)

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
