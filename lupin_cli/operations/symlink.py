"""`symlink`: a symbolic link, turned in one rename."""

from __future__ import annotations

from typing import Any, ClassVar

from lupin_cli.operations.base import Difference, OperationError
from lupin_cli.operations.paths import describe, link_atomically, read_entry, restore
from lupin_cli.operations.shell import change, quote
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Target


@dataclass(frozen=True, kw_only=True)
class Symlink:
    """`path` is a link to `to`, or there is no link. A file or directory in its place is never removed."""

    name: ClassVar[str] = "symlink"
    stands: ClassVar[bool] = True

    path: str
    to: str = ""
    present: bool = True
    root: bool = False
    machine: str = "robot"

    def __post_init__(self) -> None:
        if self.present and not self.to:
            raise ValueError("where 'to' does the link point?")

    def differs(self, target: Target) -> Difference | None:
        entry = read_entry(target, self.path, self.root)
        if entry.kind not in ("absent", "link"):
            raise OperationError(
                f"{self.path} on {target.name} is a {entry.kind}; a link won't replace it", f"ls -ld {self.path}"
            )
        before = describe(entry, None)
        if not self.present:
            return None if entry.kind == "absent" else Difference(f"the link {self.path} goes away", "", before)
        if entry.points_to == self.to:
            return None
        old = f"-{self.path} -> {entry.points_to}\n" if entry.kind == "link" else ""
        return Difference(f"{self.path} points to {self.to}", f"{old}+{self.path} -> {self.to}", before)

    def change(self, target: Target, difference: Difference) -> None:
        if self.present:
            link_atomically(target, self.path, self.to, self.root)
        else:
            change(target, f"rm -f -- {quote(self.path)}", f"remove {self.path}", root=self.root)

    def undo(self, target: Target, before: dict[str, Any]) -> None:
        restore(target, self.path, before, self.root)
