"""`directory`: a directory with these rights and this owner - or none, where it is empty."""

from __future__ import annotations

from typing import Any, ClassVar

from lupin_cli.operations.base import Difference, OperationError
from lupin_cli.operations.file import MODE
from lupin_cli.operations.paths import own, read_entry
from lupin_cli.operations.shell import change, quote, read
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Target


@dataclass(frozen=True, kw_only=True)
class Directory:
    """Parents are made as they are needed. What holds something is never removed, neither here nor by undo."""

    name: ClassVar[str] = "directory"
    stands: ClassVar[bool] = True

    path: str
    mode: str | None = None
    owner: str | None = None  # user:group
    present: bool = True
    root: bool = False
    machine: str = "robot"

    def __post_init__(self) -> None:
        if self.mode is not None and not MODE.match(self.mode):
            raise ValueError(f'a mode is three octal digits in quotes, such as "0755", not {self.mode!r}')

    def differs(self, target: Target) -> Difference | None:
        entry = read_entry(target, self.path, self.root)
        if entry.kind not in ("absent", "directory"):
            raise OperationError(f"{self.path} on {target.name} is a {entry.kind}, not a directory", f"ls -ld {self.path}")
        if not self.present:
            if entry.kind == "absent":
                return None
            return Difference(
                f"the directory {self.path} goes away", "", {"kind": "directory", "mode": entry.mode, "owner": entry.owner}
            )
        if entry.kind == "absent":
            return Difference(f"the directory {self.path} is made", "", {"kind": "absent", "made": self._missing(target)})
        changes = []
        if self.mode is not None and int(entry.mode, 8) != int(self.mode, 8):
            changes.append(f"mode {entry.mode} becomes {self.mode}")
        if self.owner is not None and entry.owner != self.owner:
            changes.append(f"owner {entry.owner} becomes {self.owner}")
        if not changes:
            return None
        return Difference(
            f"{self.path}: {', '.join(changes)}", "", {"kind": "directory", "mode": entry.mode, "owner": entry.owner}
        )

    def _missing(self, target: Target) -> list[str]:
        """The directories that will be made, the deepest first."""
        script = f'd={quote(self.path)}; while [ ! -e "$d" ]; do printf "%s\\n" "$d"; d=$(dirname -- "$d"); done'
        return read(target, script, f"the parents of {self.path}", root=self.root).splitlines()

    def change(self, target: Target, difference: Difference) -> None:
        name = quote(self.path)
        if not self.present:
            change(target, f"rmdir -- {name}", f"remove {self.path}", root=self.root, next_command=f"ls -la {self.path}")
            return
        mode = f" && chmod {self.mode} -- {name}" if self.mode else ""
        change(target, f"mkdir -p -- {name}{mode}", f"make {self.path}", root=self.root)
        if self.owner:
            own(target, self.path, self.owner, self.root)

    def undo(self, target: Target, before: dict[str, Any]) -> None:
        name = quote(self.path)
        if before["kind"] == "absent":
            made = " ".join(quote(path) for path in before["made"])
            script = f'for d in {made}; do [ ! -d "$d" ] || rmdir -- "$d" || exit 1; done'
            change(target, script, f"remove {self.path}", root=self.root, next_command=f"ls -la {self.path}")
            return
        change(target, f"mkdir -p -- {name} && chmod {before['mode']} -- {name}", f"put {self.path} back", root=self.root)
        own(target, self.path, before["owner"], self.root)
