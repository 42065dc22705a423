"""`file`: a file with this content, these rights and this owner - or none."""

from __future__ import annotations

import re
from typing import Any, ClassVar

from lupin_cli.operations.base import Difference
from lupin_cli.operations.paths import Entry, describe, own, read_file, restore, unified_diff
from lupin_cli.operations.shell import change, quote
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.shipped import shipped_folder
from lupin_cli.target.base import Target

MODE = re.compile(r"0?[0-7]{3}\Z")


@dataclass(frozen=True, kw_only=True)
class File:
    """Written whole or not at all; what stood there is kept for undo. `mode` and `owner` count only where they are given."""

    name: ClassVar[str] = "file"
    stands: ClassVar[bool] = True

    path: str
    content: str | None = None  # without it and `source`: only its rights and owner, or its absence, are asked for
    source: str = ""  # a file that Lupin ships: systemd/lupin-clock-sync.sh
    mode: str | None = None
    owner: str | None = None  # user:group
    present: bool = True
    root: bool = False
    machine: str = "robot"

    def __post_init__(self) -> None:
        if self.mode is not None and not MODE.match(self.mode):
            raise ValueError(f'a mode is three octal digits in quotes, such as "0644", not {self.mode!r}')
        if self.owner is not None and ":" not in self.owner:
            raise ValueError(f"an owner is user:group, not {self.owner!r}")
        if self.content is not None and self.source:
            raise ValueError("either content or source")
        if self.source and self._wanted() is None:
            raise ValueError(f"Lupin ships no {self.source!r}")
        if not self.path.startswith(("/", "~/")):
            raise ValueError(f"a path begins with / or ~/, unlike {self.path!r}")

    def _wanted(self) -> bytes | None:
        if self.source:
            folder, _, name = self.source.partition("/")
            path = shipped_folder(folder) / name
            known = folder in ("playbooks", "systemd") and "/" not in name
            return path.read_bytes() if known and path.is_file() else None
        return None if self.content is None else self.content.encode()

    def differs(self, target: Target) -> Difference | None:
        entry, old, _ = read_file(target, self.path, self.root)
        if not self.present:
            if entry.kind == "absent":
                return None
            return Difference(f"{self.path} goes away", unified_diff(self.path, old, None), describe(entry, old))
        changes = self._changes(entry, old)
        if not changes:
            return None
        new = old if self._wanted() is None else self._wanted()
        text = unified_diff(self.path, old, new) if new != old else ""
        return Difference(f"{self.path}: {', '.join(changes)}", text, describe(entry, old))

    def _changes(self, entry: Entry, old: bytes | None) -> list[str]:
        changes = []
        if entry.kind == "absent":
            return ["is written"] if self._wanted() is not None else ["is made, empty"]
        if entry.kind != "file":
            changes.append(f"a {entry.kind} becomes a file")
        elif self._wanted() is not None and old != self._wanted():
            changes.append("its content changes")
        if self.mode is not None and int(entry.mode or "0", 8) != int(self.mode, 8):
            changes.append(f"mode {entry.mode} becomes {self.mode}")
        if self.owner is not None and entry.owner != self.owner:
            changes.append(f"owner {entry.owner} becomes {self.owner}")
        return changes

    def change(self, target: Target, difference: Difference) -> None:
        if not self.present:
            change(target, f"rm -f -- {quote(self.path)}", f"remove {self.path}", root=self.root)
            return
        before = difference.before
        mode = self.mode or before.get("mode") or "644"
        if self._wanted() is not None or before["kind"] == "absent":
            target.put(self.path, self._wanted() or b"", mode=int(mode, 8), root=self.root)
        elif self.mode is not None:
            change(target, f"chmod {mode} -- {quote(self.path)}", f"set the mode of {self.path}", root=self.root)
        owner = self.owner or before.get("owner")  # a file that is written anew would else become the writer's
        if owner:
            own(target, self.path, owner, self.root)

    def undo(self, target: Target, before: dict[str, Any]) -> None:
        restore(target, self.path, before, self.root)
