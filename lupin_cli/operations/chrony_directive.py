"""`chrony-directive`: a directive is commented out in every file that chronyd reads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from lupin_cli.connection.base import Output, Script, Target
from lupin_cli.facts.chrony_configuration import READER, comment_out, parse_line
from lupin_cli.facts.sections import PRELUDE
from lupin_cli.operations.base import Difference, Operation, OperationError, probe_script
from lupin_cli.operations.path_state import parse_state, put_owned, state_script
from lupin_cli.operations.shell import query, text_of


@dataclass(frozen=True, kw_only=True)
class ChronyDirective(Operation):
    """In any spelling, in the main file and in those that it includes, by `include` and `confdir`."""

    name: ClassVar[str] = "chrony-directive"
    effect: ClassVar[str] = "a directive is commented out in every file that chronyd reads"
    undo_effect: ClassVar[str] = "the lines that were commented out count again"

    commented: str

    def __post_init__(self) -> None:
        if not self.commented.isalpha() or not self.commented.islower():
            raise ValueError(f"a directive of chrony is a word in lower case, not {self.commented!r}")

    def probe(self) -> Script:
        return probe_script(f"{PRELUDE}{READER}\nchrony_lines {self.commented}\nexit 0", root=True)

    def judge(self, output: Output) -> Difference | None:
        found: dict[str, list[str]] = {}
        diff = []
        # Not splitlines: a line may end with the carriage return of another system.
        for line in text_of(output, "chrony's configuration").rstrip("\n").split("\n"):
            file, _ = parse_line(line)
            if not file:
                continue
            found.setdefault(file, []).append(line.removeprefix(f"{file}:").partition(":")[2])
            diff.append(f"-{line}")
        if not found:
            return None
        return Difference(f"comment out {self.commented} in {', '.join(found)}", "\n".join(diff), {"lines": found})

    def change(self, target: Target, difference: Difference) -> None:
        for path in difference.before["lines"]:
            self._edit(target, path, comment_out(_read(target, path), self.commented))

    def undo(self, target: Target, before: Mapping[str, Any]) -> None:
        for path, commented in before["lines"].items():
            rows = _read(target, path).split("\n")
            for line in commented:
                if rows.count(line) < commented.count(line) and f"# {line}" in rows:
                    rows[rows.index(f"# {line}")] = line
            self._edit(target, path, "\n".join(rows))

    def _edit(self, target: Target, path: str, text: str) -> None:
        state = parse_state(query(target, state_script(path), root=True), path)
        if state.kind != "file":
            raise OperationError(f"{path} is a {state.kind}, not a file; comment out {self.commented} there", f"ls -ld {path}")
        put_owned(target, path, text.encode("utf-8", "surrogateescape"), int(state.mode, 8), state.owner, True)


def _read(target: Target, path: str) -> str:
    return (target.get(path, root=True) or b"").decode("utf-8", "surrogateescape")
