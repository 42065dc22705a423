"""`command`: a shell script for what no other operation does; its guard says whether there is anything to do."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from lupin_cli.connection.base import Output, Script, Target
from lupin_cli.operations.base import Difference, Operation, OperationError, probe_script
from lupin_cli.operations.shell import change, quote


@dataclass(frozen=True, kw_only=True)
class Command(Operation):
    """Runs `run` unless `unless` succeeds or `creates` exists; afterwards one of them must hold. `reverse` undoes it."""

    name: ClassVar[str] = "command"
    effect: ClassVar[str] = "the condition of its guard, `unless` or `creates`"
    undo_effect: ClassVar[str] = "by `reverse`"
    prefetchable: ClassVar[bool] = True

    run: str
    unless: str = ""  # a read-only script that succeeds if there is nothing to do
    creates: str = ""  # a path that exists if there is nothing to do
    reverse: str = ""  # the script for undo; without it, undo fails
    root: bool = False
    timeout_s: float = 60.0

    def __post_init__(self) -> None:
        if not (self.unless or self.creates):
            raise ValueError("it needs a guard, unless: SCRIPT or creates: PATH; otherwise every run would repeat it")

    def probe(self) -> Script:
        guards = [f"( {self.unless}\n) >/dev/null"] if self.unless else []
        guards += [f"[ -e {quote(self.creates)} ]"] if self.creates else []
        return probe_script(" || ".join(guards), root=self.root)

    def judge(self, output: Output) -> Difference | None:
        if output.ok:
            return None
        return Difference(f"run: {_first_line(self.run)}", f"+{self.run.strip()}".replace("\n", "\n+"), {"ran": True})

    def change(self, target: Target, difference: Difference) -> None:
        change(target, self.run, f"run {_first_line(self.run)!r}", root=self.root, timeout_s=self.timeout_s)

    def undo(self, target: Target, before: Mapping[str, Any]) -> None:
        if not self.reverse:
            raise OperationError(
                f"the step has no script that undoes {_first_line(self.run)!r}; give it one with reverse: SCRIPT"
            )
        change(target, self.reverse, f"run {_first_line(self.reverse)!r}", root=self.root, timeout_s=self.timeout_s)


def _first_line(script: str) -> str:
    return (script.strip() or "nothing").splitlines()[0]
