"""`symlink`: a symbolic link, replaced in one rename."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from lupin_cli.connection.base import Output, Script, Target
from lupin_cli.operations.base import Difference, Operation, OperationError, RestoredFile, probe_script
from lupin_cli.operations.path_state import all_of, link_atomically, parse_state, remove, restore, state_script


@dataclass(frozen=True, kw_only=True)
class Symlink(Operation):
    """`path` is a link to `to`, or there is no link. Never removes a file or directory at `path`."""

    name: ClassVar[str] = "symlink"
    effect: ClassVar[str] = "a symbolic link points to `to`, or does not exist; it is replaced in one rename"
    undo_effect: ClassVar[str] = "yes"
    prefetchable: ClassVar[bool] = True

    path: str
    to: str = ""
    present: bool = True
    root: bool = False

    def __post_init__(self) -> None:
        if self.present and not self.to:
            raise ValueError("it needs 'to', the path that the link points to")

    def probe(self) -> Script:
        return probe_script(state_script(self.path), root=self.root)

    def judge(self, output: Output) -> Difference | None:
        state = parse_state(output, self.path)
        if state.kind not in ("absent", "link"):
            raise OperationError(f"{self.path} is a {state.kind}; a link won't replace it", f"ls -ld {self.path}")
        before = {"kind": "link", "points_to": state.points_to} if state.kind == "link" else {"kind": "absent"}
        if not self.present:
            return None if state.kind == "absent" else Difference(f"remove the link {self.path}", "", before)
        if state.points_to == self.to:
            return None
        old = f"-{self.path} -> {state.points_to}\n" if state.kind == "link" else ""
        return Difference(f"point {self.path} to {self.to}", f"{old}+{self.path} -> {self.to}", before)

    def change(self, target: Target, difference: Difference) -> None:
        if self.present:
            link_atomically(target, self.path, self.to, self.root)
        else:
            remove(target, self.path, self.root)

    def restored_files(self) -> tuple[RestoredFile, ...]:
        return (RestoredFile(self.path, self.root),)

    def overwritten(self, output: Output) -> dict[str, bytes]:
        return {self.path: all_of(parse_state(output, self.path))}

    def undo(self, target: Target, before: Mapping[str, Any]) -> None:
        restore(target, self.path, before, self.root)
