"""`line-in-file`: one line in a file that other programs or people edit too."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from lupin_cli.connection.base import Output, Script, Target
from lupin_cli.operations.base import Difference, Operation, OperationError, RestoredFile, probe_script
from lupin_cli.operations.path_state import (
    all_of,
    complete_file,
    file_script,
    parse_file,
    put_owned,
    restore,
    state_before,
    unified_diff,
)

_STATES = ("present", "absent", "commented")


@dataclass(frozen=True, kw_only=True)
class LineInFile(Operation):
    """The file contains `line` once instead of the lines that match; or no line that matches.

    `state: present` replaces the last match by the line, or appends it if none matches, and removes the other matches, since
    the last of several settings often wins. `absent` removes matches, `commented` puts `# ` before them. A line matches if it
    equals `line`, or if the regular expression `matches` is found in it.
    """

    name: ClassVar[str] = "line-in-file"
    effect: ClassVar[str] = "a file contains a line once, does not contain it, or has it commented out"
    undo_effect: ClassVar[str] = "byte for byte"
    prefetchable: ClassVar[bool] = True

    path: str
    line: str = ""
    matches: str = ""
    state: str = "present"  # present | absent | commented
    root: bool = False

    def __post_init__(self) -> None:
        if self.state not in _STATES:
            raise ValueError(f"a line's state is present, absent or commented, not {self.state!r}")
        if self.state == "present" and not self.line:
            raise ValueError("it needs 'line', the line to be present")
        if not self.line and not self.matches:
            raise ValueError("it needs 'line' or 'matches'")
        if "\n" in self.line:
            raise ValueError("'line' must not contain a line break")
        try:
            re.compile(self.matches)
        except re.error as error:
            raise ValueError(f"'matches' is not a regular expression: {error}") from error

    def edit(self, text: str) -> str:
        """Return the edited text. Idempotent."""
        pattern = re.compile(self.matches) if self.matches else None
        ending = "\r\n" if "\r\n" in text else "\n"
        lines = text.split(ending)
        ends_with_newline = lines[-1] == ""
        if ends_with_newline:
            lines.pop()
        # An empty `line` equals no line, not even an empty one.
        hits = [
            i
            for i, line in enumerate(lines)
            if (self.line and line == self.line) or (pattern is not None and pattern.search(line))
        ]
        if self.state == "commented":
            hits = [i for i in hits if not lines[i].lstrip().startswith("#")]
            for i in hits:
                lines[i] = f"# {lines[i]}"
        elif self.state == "absent":
            # If a last line without a line break is removed, the line before it ends with one.
            ends_with_newline = ends_with_newline or len(lines) - 1 in hits
            lines = [line for i, line in enumerate(lines) if i not in set(hits)]
        elif hits:
            lines[hits[-1]] = self.line
            lines = [line for i, line in enumerate(lines) if i not in set(hits[:-1])]
        else:
            lines.append(self.line)
            ends_with_newline = True
        return ending.join(lines) + (ending if ends_with_newline and lines else "")

    def probe(self) -> Script:
        return probe_script(file_script(self.path), root=self.root)

    def complete(self, target: Target, output: Output) -> Output:
        return complete_file(target, output, self.path, self.root, follow_link=True)

    def judge(self, output: Output) -> Difference | None:
        state = parse_file(output, self.path)
        if state.kind not in ("file", "absent", "link"):
            raise OperationError(f"{self.path} is a {state.kind}, not a file", f"ls -ld {self.path}")
        old = state.content
        if old is None and self.state != "present":
            return None
        try:
            new = self.edit((old or b"").decode()).encode()
        except UnicodeDecodeError as error:
            raise OperationError(f"{self.path} is not UTF-8 text") from error
        if new == old:
            return None
        pattern = repr(self.matches or self.line)
        summary = {
            "present": f"set the line {self.line!r} in {self.path}",
            "absent": f"remove lines that match {pattern} from {self.path}",
            "commented": f"comment out lines that match {pattern} in {self.path}",
        }[self.state]
        return Difference(summary, unified_diff(self.path, old, new), state_before(state))

    def change(self, target: Target, difference: Difference) -> None:
        if difference.before["kind"] == "link":
            raise OperationError(f"{self.path} is a link to {difference.before['points_to']}: name that file in the step")
        old = target.get(self.path, root=self.root) or b""
        mode = int(difference.before.get("mode", "644"), 8)
        owner = str(difference.before.get("owner", ""))
        put_owned(target, self.path, self.edit(old.decode()).encode(), mode, owner, self.root)

    def restored_files(self) -> tuple[RestoredFile, ...]:
        return (RestoredFile(self.path, self.root),)

    def overwritten(self, output: Output) -> dict[str, bytes]:
        return {self.path: all_of(parse_file(output, self.path))}

    def undo(self, target: Target, before: Mapping[str, Any]) -> None:
        restore(target, self.path, before, self.root)
