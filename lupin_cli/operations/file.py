"""`file`: a file with the given content, mode and owner, or no file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from lupin_cli.connection.base import Output, Script, Target
from lupin_cli.operations.base import Difference, RestoredFile, probe_script
from lupin_cli.operations.path_operation import PathOperation
from lupin_cli.operations.path_state import (
    FileState,
    all_of,
    complete_file,
    file_script,
    parse_file,
    put_owned,
    remove,
    restore,
    set_attributes,
    state_before,
    unified_diff,
)
from lupin_cli.package_data import shipped_folder
from lupin_cli.release import verify_release

# The last one has a program that also runs on the robot.
_SHIPPED_FOLDERS = {
    **{name: shipped_folder(name) for name in ("playbooks", "systemd")},
    "release": Path(verify_release.__file__).parent,
}


@dataclass(frozen=True, kw_only=True)
class File(PathOperation):
    """Writes the file atomically.

    Without `content` and `source` it only sets mode and owner, or removes the file; a missing file is created empty.
    """

    name: ClassVar[str] = "file"
    effect: ClassVar[str] = "a file has this content, mode and owner, or does not exist; it is written whole or not at all"
    undo_effect: ClassVar[str] = "byte for byte"

    content: str | None = None
    source: str = ""  # a file that Lupin ships: systemd/lupin-clock-sync.sh

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.content is not None and self.source:
            raise ValueError("give either content or source")
        if self.source and self._new_content() is None:
            raise ValueError(f"Lupin ships no {self.source!r}")
        if not self.path.startswith(("/", "~/")):
            raise ValueError(f"a path must begin with / or ~/: {self.path!r}")

    def _new_content(self) -> bytes | None:
        if self.source:
            folder, _, name = self.source.partition("/")
            if folder not in _SHIPPED_FOLDERS or "/" in name:
                return None
            path = _SHIPPED_FOLDERS[folder] / name
            return path.read_bytes() if path.is_file() else None
        return None if self.content is None else self.content.encode()

    def probe(self) -> Script:
        return probe_script(file_script(self.path), root=self.root)

    def complete(self, target: Target, output: Output) -> Output:
        return complete_file(target, output, self.path, self.root)

    def judge(self, output: Output) -> Difference | None:
        state = parse_file(output, self.path)
        if not self.present:
            if state.kind == "absent":
                return None
            return Difference(f"remove {self.path}", unified_diff(self.path, state.content, None), state_before(state))
        summary = self._summary(state)
        if not summary:
            return None
        new = state.content if self._new_content() is None else self._new_content()
        diff = unified_diff(self.path, state.content, new) if new != state.content else ""
        return Difference(summary, diff, state_before(state))

    def _summary(self, state: FileState) -> str:
        if state.kind == "absent":
            return f"create {self.path}" + ("" if self._new_content() is not None else ", empty")
        changes = self.attribute_changes(state)
        if state.kind != "file":
            changes.insert(0, f"replace the {state.kind} by a file")
        elif self._new_content() is not None and state.content != self._new_content():
            changes.insert(0, "content")
        return f"change {self.path}: {', '.join(changes)}" if changes else ""

    def change(self, target: Target, difference: Difference) -> None:
        if not self.present:
            remove(target, self.path, self.root)
            return
        before = difference.before
        owner = self.owner or before.get("owner") or ""  # a file that is replaced would otherwise become the writer's
        if self._new_content() is not None or before["kind"] == "absent":
            mode = self.mode or before.get("mode") or "644"
            put_owned(target, self.path, self._new_content() or b"", int(mode, 8), owner, self.root)
        else:
            set_attributes(target, self.path, mode=self.mode or "", owner=owner, root=self.root)

    def restored_files(self) -> tuple[RestoredFile, ...]:
        return (RestoredFile(self.path, self.root),)

    def overwritten(self, output: Output) -> dict[str, bytes]:
        return {self.path: all_of(parse_file(output, self.path))}

    def undo(self, target: Target, before: Mapping[str, Any]) -> None:
        restore(target, self.path, before, self.root)
