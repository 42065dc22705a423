"""`command`: a shell script, where no operation knows what is wanted; its guard says when it has nothing to do."""

from __future__ import annotations

from typing import Any, ClassVar

from lupin_cli.operations.base import Difference, OperationError
from lupin_cli.operations.shell import change, look, quote
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Target


@dataclass(frozen=True, kw_only=True)
class Command:
    """`run` is done unless `unless` succeeds or `creates` exists, and then one of them must hold. `reverse` takes it back."""

    name: ClassVar[str] = "command"
    stands: ClassVar[bool] = True

    run: str
    unless: str = ""  # a script that succeeds where nothing is to do; it changes nothing
    creates: str = ""  # a path that is there where nothing is to do
    reverse: str = ""  # a script for undo; without it, undo says that it can't
    root: bool = False
    timeout_s: float = 60.0
    machine: str = "robot"

    def __post_init__(self) -> None:
        if not (self.unless or self.creates):
            raise ValueError("it needs a guard, or a second run would do it again: unless: SCRIPT or creates: PATH")

    def _guard(self) -> str:
        parts = ([f"( {self.unless}\n) >/dev/null"] if self.unless else []) + (
            [f"[ -e {quote(self.creates)} ]"] if self.creates else []
        )
        return " || ".join(parts)

    def differs(self, target: Target) -> Difference | None:
        if look(target, self._guard(), root=self.root).ok:
            return None
        first = self.run.strip().splitlines()[0]
        return Difference(f"runs: {first}", f"+{self.run.strip()}".replace("\n", "\n+"), {"ran": True})

    def change(self, target: Target, difference: Difference) -> None:
        change(target, self.run, f"run {self.run.strip().splitlines()[0]!r}", root=self.root, bound_s=self.timeout_s)

    def undo(self, target: Target, before: dict[str, Any]) -> None:
        if not self.reverse:
            raise OperationError(f"nobody said how to take back {self.run.strip().splitlines()[0]!r}: reverse: SCRIPT")
        change(target, self.reverse, f"run {self.reverse.strip().splitlines()[0]!r}", root=self.root, bound_s=self.timeout_s)
