"""`line-in-file`: one line in a file that others write too."""

from __future__ import annotations

import re
from typing import Any, ClassVar

from lupin_cli.operations.base import Difference, OperationError
from lupin_cli.operations.paths import describe, own, read_file, restore, unified_diff
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Target


@dataclass(frozen=True, kw_only=True)
class LineInFile:
    """`line` stands in the file once, in place of what `matches`; or nothing that `matches` does.

    `state: present` puts the line where the last match stands, else at the end; further matches go, since the last of two
    settings often wins. `absent` removes matches, `commented` puts `# ` before them. `matches` is a regular expression that is
    looked for within a line; without it, the line itself.
    """

    name: ClassVar[str] = "line-in-file"
    stands: ClassVar[bool] = True

    path: str
    line: str = ""
    matches: str = ""
    state: str = "present"  # present | absent | commented
    root: bool = False
    machine: str = "robot"

    def __post_init__(self) -> None:
        if self.state not in ("present", "absent", "commented"):
            raise ValueError(f"a line's state is present, absent or commented, not {self.state!r}")
        if self.state == "present" and not self.line:
            raise ValueError("which 'line' is to be present?")
        if not self.line and not self.matches:
            raise ValueError("it needs 'line' or 'matches'")
        if "\n" in self.line:
            raise ValueError("a line has no line break")
        try:
            re.compile(self.matches)
        except re.error as error:
            raise ValueError(f"'matches' is not a regular expression: {error}") from error

    def edited(self, text: str) -> str:
        """The text as it should be. Its own output stays as it is."""
        pattern = re.compile(self.matches) if self.matches else None
        ending = "\r\n" if "\r\n" in text else "\n"
        lines = text.split(ending)
        closed = lines[-1] == ""
        if closed:
            lines.pop()
        # Without a `line` nothing is equal to it, an empty line least of all.
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
            lines = [line for i, line in enumerate(lines) if i not in set(hits)]
        elif hits:
            lines[hits[-1]] = self.line
            lines = [line for i, line in enumerate(lines) if i not in set(hits[:-1])]
        else:
            lines.append(self.line)
            closed = True
        return ending.join(lines) + (ending if closed and lines else "")

    def differs(self, target: Target) -> Difference | None:
        entry, old, _ = read_file(target, self.path, self.root)
        if entry.kind not in ("file", "absent", "link"):
            raise OperationError(f"{self.path} on {target.name} is a {entry.kind}, not a file")
        if entry.kind == "link":
            old = target.get(self.path, root=self.root)
        if old is None and self.state != "present":
            return None
        try:
            new = self.edited((old or b"").decode()).encode()
        except UnicodeDecodeError as error:
            raise OperationError(f"{self.path} on {target.name} is not UTF-8 text") from error
        if new == old:
            return None
        what = {"present": f"gets the line {self.line!r}", "absent": "loses", "commented": "has commented out"}[self.state]
        summary = f"{self.path} {what}" + ("" if self.state == "present" else f" what matches {self.matches or self.line}")
        return Difference(summary, unified_diff(self.path, old, new), describe(entry, old))

    def change(self, target: Target, difference: Difference) -> None:
        if difference.before["kind"] == "link":
            raise OperationError(f"{self.path} is a link to {difference.before['points_to']}: name that file in the step")
        old = target.get(self.path, root=self.root) or b""
        mode = int(difference.before.get("mode", "644"), 8)
        target.put(self.path, self.edited(old.decode()).encode(), mode=mode, root=self.root)
        if "owner" in difference.before:
            own(target, self.path, difference.before["owner"], self.root)

    def undo(self, target: Target, before: dict[str, Any]) -> None:
        restore(target, self.path, before, self.root)
