"""`directory`: a directory with the given mode and owner, or no directory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from lupin_cli.connection.base import Output, Script, Target
from lupin_cli.operations.base import Difference, OperationError, probe_script
from lupin_cli.operations.path_operation import PathOperation
from lupin_cli.operations.path_state import chown, parse_state, state_script
from lupin_cli.operations.shell import change, quote

# The directories that do not exist yet, the deepest first.
_MISSING = """
d={path}
while [ ! -e "$d" ]; do printf '%s\\n' "$d"; d=$(dirname -- "$d"); done
"""


@dataclass(frozen=True, kw_only=True)
class Directory(PathOperation):
    """Creates parents as needed. Neither a change nor an undo removes a directory that is not empty."""

    name: ClassVar[str] = "directory"
    effect: ClassVar[str] = "a directory has this mode and owner, or does not exist; only an empty one is removed"
    undo_effect: ClassVar[str] = "yes, including the parents that were created"

    def probe(self) -> Script:
        return probe_script(state_script(self.path) + _MISSING.format(path=quote(self.path)), root=self.root)

    def judge(self, output: Output) -> Difference | None:
        state = parse_state(output, self.path)
        if state.kind not in ("absent", "directory"):
            raise OperationError(f"{self.path} is a {state.kind}, not a directory", f"ls -ld {self.path}")
        before = {"kind": "directory", "mode": state.mode, "owner": state.owner}
        if not self.present:
            return None if state.kind == "absent" else Difference(f"remove the directory {self.path}", "", before)
        if state.kind == "absent":
            missing = output.stdout.splitlines()[1:]
            if not missing:
                raise OperationError(f"could not read the parents of {self.path}", f"ls -ld {self.path}")
            return Difference(f"create the directory {self.path}", "", {"kind": "absent", "made": missing})
        changes = self.attribute_changes(state)
        return Difference(f"change {self.path}: {', '.join(changes)}", "", before) if changes else None

    def change(self, target: Target, difference: Difference) -> None:
        name = quote(self.path)
        if not self.present:
            change(target, f"rmdir -- {name}", f"remove {self.path}", root=self.root, next_command=f"ls -la {self.path}")
            return
        mode = f" && chmod {self.mode} -- {name}" if self.mode else ""
        change(target, f"mkdir -p -- {name}{mode}", f"create {self.path}", root=self.root)
        if self.owner:
            chown(target, self.path, self.owner, self.root)

    def undo(self, target: Target, before: Mapping[str, Any]) -> None:
        name = quote(self.path)
        if before["kind"] == "absent":
            made = " ".join(quote(path) for path in before["made"])
            script = f'for d in {made}; do [ ! -d "$d" ] || rmdir -- "$d" || exit 1; done'
            change(target, script, f"remove {self.path}", root=self.root, next_command=f"ls -la {self.path}")
            return
        change(target, f"mkdir -p -- {name} && chmod {before['mode']} -- {name}", f"restore {self.path}", root=self.root)
        chown(target, self.path, before["owner"], self.root)
