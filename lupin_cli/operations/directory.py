"""`directory`: a directory with the given mode and owner, or no directory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from lupin_cli.connection.base import Output, Script, Target
from lupin_cli.connection.shell_file_io import SAFE_PATHS
from lupin_cli.operations.base import Difference, OperationError, probe_script
from lupin_cli.operations.path_operation import PathOperation
from lupin_cli.operations.path_state import parse_state, set_attributes, state_script
from lupin_cli.operations.shell import change, quote, quote_all

# The directories that do not exist yet, the deepest first.
_MISSING = """
d={path}
while [ ! -e "$d" ]; do printf '%s\\n' "$d"; d=$(dirname -- "$d"); done
"""
_CREATE = """
path={path} existing={path}
while [ ! -e "$existing" ] && [ ! -L "$existing" ]; do existing=$(dirname -- "$existing"); done
enter_folder "$existing/." || exit 1
missing=${{path#"$existing"}}
mkdir -p -- "./${{missing#/}}" || exit 1
enter_folder "$path/."
"""
_REMOVE = """
for path in {paths}; do [ ! -d "$path" ] || {{ enter_folder "$path" && rmdir -- "./$name"; }} || exit 1; done
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
        if not self.present:
            self._remove(target, [self.path])
            return
        self._create(target)
        if self.mode or self.owner:
            set_attributes(target, self.path, mode=self.mode or "", owner=self.owner or "", root=self.root)

    def undo(self, target: Target, before: Mapping[str, Any]) -> None:
        if before["kind"] == "absent":
            self._remove(target, before["made"])
            return
        self._create(target)
        # With five digits, chmod also clears the set-user-ID and set-group-ID bits.
        set_attributes(target, self.path, mode=before["mode"].zfill(5), owner=before["owner"], root=self.root)

    def _create(self, target: Target) -> None:
        change(target, SAFE_PATHS + _CREATE.format(path=quote(self.path)), f"create {self.path}", root=self.root)

    def _remove(self, target: Target, paths: Sequence[str]) -> None:
        script = SAFE_PATHS + _REMOVE.format(paths=quote_all(paths))
        change(target, script, f"remove {self.path}", root=self.root, next_command=f"ls -la {self.path}")
