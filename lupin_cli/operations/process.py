"""`process`: a program that must not run; it is identified exactly and terminated by PID, never by a pattern."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from lupin_cli.connection.base import Output, Script, Target
from lupin_cli.operations.base import Difference, Operation, OperationError, probe_script
from lupin_cli.operations.shell import change, quote, text_of

_NAME_LENGTH = 15  # the kernel cuts a process's name to this length; the command line has all of it

# One process a line, this shell excluded: PID, start in ticks since boot, command line.
_PROBE = r"""
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

# The PID may belong to another process by now; the start time shows that. A process that ignores TERM gets KILL.
_TERMINATE = r"""
start_of() { sed 's/.*) //' "/proc/$1/stat" 2>/dev/null | cut -d' ' -f20; }
alive() { [ "$(start_of "$1")" = "$2" ] && ! grep -q '^State:[[:space:]]*Z' "/proc/$1/status" 2>/dev/null; }
terminate() {
  for signal in TERM KILL; do
    alive "$1" "$2" || return 0
    kill -s "$signal" "$1" 2>/dev/null
    n=0
    while [ "$n" -lt TENTHS ]; do alive "$1" "$2" || return 0; sleep 0.1; n=$((n + 1)); done
  done
  echo "process $1 does not terminate" >&2
  return 1
}
"""


@dataclass(frozen=True, kw_only=True)
class Process(Operation):
    """No process runs whose program is named exactly `named` and whose command line contains `holding`, if that is given.

    A terminated process cannot be restored: give the step `undo: false`, or undo stops there.
    """

    name: ClassVar[str] = "process"
    effect: ClassVar[str] = "a program does not run; it is terminated by PID, never by a pattern"
    undo_effect: ClassVar[str] = "impossible; give the step `undo: false`"

    named: str
    holding: str = ""
    root: bool = False
    grace_s: float = 3.0

    def __post_init__(self) -> None:
        if not self.named or "/" in self.named or any(c in self.named for c in "*?[|\n"):
            raise ValueError(f"'named' is a program's exact name, not a path or a pattern: {self.named!r}")

    def probe(self) -> Script:
        return probe_script(_PROBE.replace("NAME", quote(self.named[:_NAME_LENGTH])), root=self.root)

    def judge(self, output: Output) -> Difference | None:
        running = [
            entry for entry in map(_parse, text_of(output, "the running processes").splitlines()) if self._matches(entry[2])
        ]
        if not running:
            return None
        lines = "\n".join(f"-{pid} {command}" for pid, _, command in running)
        pids = ", ".join(str(pid) for pid, _, _ in running)
        return Difference(f"terminate {self.named} ({pids})", lines, {"ended": [list(entry) for entry in running]})

    def _matches(self, command: str) -> bool:
        # A name that the kernel cut may be another program's, so the whole name must be in the command line.
        program = len(self.named) <= _NAME_LENGTH or any(word.rpartition("/")[2] == self.named for word in command.split()[:2])
        return program and self.holding in command

    def change(self, target: Target, difference: Difference) -> None:
        script = _TERMINATE.replace("TENTHS", str(max(1, round(self.grace_s * 10)))) + "status=0\n"
        script += "".join(f"terminate {pid} {start} || status=1\n" for pid, start, _ in difference.before["ended"])
        script += "exit $status"
        change(target, script, f"terminate {self.named}", root=self.root, next_command=f"pgrep -xa {self.named}")

    def undo(self, target: Target, before: Mapping[str, Any]) -> None:
        raise OperationError(f"{self.named} was terminated and cannot be restored: start it again by hand")


def _parse(line: str) -> tuple[int, int, str]:
    pid, start, command = (*line.split(" ", 2), "", "")[:3]
    if not (pid.isdecimal() and start.isdecimal() and pid.isascii() and start.isascii()):
        raise OperationError(f"could not read the running processes: found {line[:80]!r}", "ps -ef")
    return int(pid), int(start), command.strip()
