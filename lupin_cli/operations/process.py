"""`process`: one that must not run, ended by its number after a look at what it is - never by a pattern."""

from __future__ import annotations

from typing import Any, ClassVar

from lupin_cli.operations.base import Difference, OperationError
from lupin_cli.operations.shell import change, quote, read
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Target

# The kernel's name of a process is cut to 15 characters; its command line tells the rest.
_NAME_LENGTH = 15

# number, start in ticks since boot, kernel's name, command line: one process a line. Our own shell isn't among them.
_LOOK = r"""
for d in /proc/[0-9]*; do
  p=${d#/proc/}
  [ "$p" != "$$" ] || continue
  IFS= read -r comm <"$d/comm" || continue
  [ "$comm" = NAME ] || continue
  grep -q '^State:[[:space:]]*Z' "$d/status" && continue
  start=$(sed 's/.*) //' "$d/stat" | cut -d' ' -f20)
  printf '%s %s %s\n' "$p" "$start" "$(tr '\0\n' '  ' <"$d/cmdline")"
done 2>/dev/null
exit 0
"""

# The number may belong to another process by now: its start tells. What doesn't end on TERM is ended.
_END = r"""
start_of() { sed 's/.*) //' "/proc/$1/stat" 2>/dev/null | cut -d' ' -f20; }
alive() { [ "$(start_of "$1")" = "$2" ] && ! grep -q '^State:[[:space:]]*Z' "/proc/$1/status" 2>/dev/null; }
end() {
  for signal in TERM KILL; do
    alive "$1" "$2" || return 0
    kill -s "$signal" "$1" 2>/dev/null
    n=0
    while [ "$n" -lt TENTHS ]; do alive "$1" "$2" || return 0; sleep 0.1; n=$((n + 1)); done
  done
  echo "process $1 does not end" >&2
  return 1
}
"""


@dataclass(frozen=True, kw_only=True)
class Process:
    """None runs whose program is called exactly `named` and, where it is given, whose command line holds `holding`.

    What has ended can't be brought back: say `undo: false`, or undo stops here.
    """

    name: ClassVar[str] = "process"

    named: str
    holding: str = ""
    root: bool = False
    grace_s: float = 3.0
    machine: str = "robot"

    def __post_init__(self) -> None:
        if not self.named or "/" in self.named or any(c in self.named for c in "*?[|\n"):
            raise ValueError(f"'named' is a program's exact name, not a path or a pattern: {self.named!r}")

    def _running(self, target: Target) -> list[tuple[int, int, str]]:
        script = _LOOK.replace("NAME", quote(self.named[:_NAME_LENGTH]))
        found = []
        for line in read(target, script, "the running processes", root=self.root).splitlines():
            pid, start, command = (*line.split(" ", 2), "")[:3]
            words = command.split()
            # A cut name could be another program's: its whole name must stand in the command line.
            whole = len(self.named) <= _NAME_LENGTH or any(word.rpartition("/")[2] == self.named for word in words[:2])
            if whole and self.holding in command:
                found.append((int(pid), int(start), command.strip()))
        return found

    def differs(self, target: Target) -> Difference | None:
        running = self._running(target)
        if not running:
            return None
        lines = "\n".join(f"-{pid} {command}" for pid, _, command in running)
        pids = ", ".join(str(pid) for pid, _, _ in running)
        return Difference(f"{self.named} is ended ({pids})", lines, {"ended": [[p, s, c] for p, s, c in running]})

    def change(self, target: Target, difference: Difference) -> None:
        script = _END.replace("TENTHS", str(max(1, round(self.grace_s * 10)))) + "status=0\n"
        script += "".join(f"end {pid} {start} || status=1\n" for pid, start, _ in difference.before["ended"])
        change(target, script + "exit $status", f"end {self.named}", root=self.root, next_command=f"pgrep -xa {self.named}")

    def undo(self, target: Target, before: dict[str, Any]) -> None:
        raise OperationError(f"{self.named} was ended and can't be brought back", "lupin up")
