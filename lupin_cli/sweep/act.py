"""Looks at a machine, ends what the plan says by its number, and removes files while holding their lock."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import Any

from lupin_cli.facts.base import Fact
from lupin_cli.facts.ros_processes import ROS_PROCESSES
from lupin_cli.facts.shared_memory import SHARED_MEMORY
from lupin_cli.facts.sockets import SOCKETS
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.sweep.families import FAMILIES
from lupin_cli.sweep.rules import Culprit, Kept, Orphan, Plan, make_plan
from lupin_cli.target.base import Script, Target, TargetError

LOOK_BOUND_S = 15.0
ACT_BOUND_S = 60.0
_FACTS: tuple[Fact[Any], ...] = (ROS_PROCESSES, SOCKETS, SHARED_MEMORY, FAMILIES)

# A number may have been given to another process meanwhile: its start is compared before every signal.
_END = r"""start_of() { sed 's/.*) //' "/proc/$1/stat" 2>/dev/null | cut -d' ' -f20; }
same() { [ "$(start_of "$1")" = "$2" ] && ! grep -q '^State:.Z' "/proc/$1/status" 2>/dev/null; }
end() {
  same "$1" "$2" || { echo "ended $1"; return; }
  for signal in TERM KILL; do
    kill -s "$signal" "$1" 2>/dev/null
    [ "$signal" = TERM ] && kill -s CONT "$1" 2>/dev/null
    for tenth in 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20; do
      same "$1" "$2" || { echo "ended $1"; return; }
      sleep 0.1
    done
  done
  echo "stays $1"
}
"""
# Whoever holds the lock is alive and keeps its files; while we hold it nobody else can come to.
_REMOVE = r"""cd /dev/shm || exit 1
remove() { lock=$1; shift
  if [ -n "$lock" ]; then flock -n -x "$lock" rm -f -- "$@"; else rm -f -- "$@"; fi
  for file; do [ -e "$file" ] && { echo "stays $1"; return; }; done
  echo "removed $1"
}
"""


@dataclass(frozen=True)
class Result:
    """What a sweep did."""

    ended: tuple[Culprit, ...]
    removed: tuple[Orphan, ...]
    kept: tuple[Kept, ...]
    failed: tuple[str, ...]


def look(
    target: Target, *, user_id: int, runs: Mapping[int, str] | None = None, ourselves: frozenset[int] = frozenset()
) -> Plan:
    """What is left over on the target; changes nothing. `user_id` 0 asks as root. Raises TargetError."""
    scripts = [Script(fact.name, fact.probe, fact.timeout_s, root=user_id == 0) for fact in _FACTS]
    outputs = target.batch(scripts, bound_s=LOOK_BOUND_S)
    values = []
    for fact in _FACTS:
        try:
            values.append(fact.parse(outputs[fact.name]))
        except ValueError as error:
            raise TargetError(f"{target.name}: {fact.name} can't be read: {error}", "lupin doctor") from error
    processes, sockets, files, families = values
    return make_plan(processes, sockets, files, families, user_id=user_id, runs=runs, ourselves=ourselves)


def sweep(
    target: Target, *, user_id: int, runs: Mapping[int, str] | None = None, ourselves: frozenset[int] = frozenset()
) -> Result:
    """End and remove what `look` finds: processes first, since theirs is what they then leave. Raises TargetError."""
    plan = look(target, user_id=user_id, runs=runs, ourselves=ourselves)
    culprits, said = plan.culprits, set()
    if culprits:
        lines = [f"end {culprit.pid} {culprit.start_ticks} &" for culprit in culprits]
        said |= _run(target, _END + "\n".join([*lines, "wait"]), user_id)
        plan = look(target, user_id=user_id, runs=runs, ourselves=ourselves)
    if plan.orphans:
        lines = [shlex.join(["remove", orphan.lock, *orphan.files]) for orphan in plan.orphans]
        said |= _run(target, _REMOVE + "\n".join(lines), user_id)
    ended = tuple(culprit for culprit in culprits if f"ended {culprit.pid}" in said)
    removed = tuple(orphan for orphan in plan.orphans if f"removed {orphan.files[0]}" in said)
    failed = [f"{each.name} ({each.pid}) could not be ended" for each in culprits if each not in ended]
    failed += [f"{each.files[0]} could not be removed: in use by now" for each in plan.orphans if each not in removed]
    return Result(ended, removed, plan.kept, tuple(failed))


def _run(target: Target, script: str, user_id: int) -> set[str]:
    """The lines that a script of ours answered. A link that was cut shows as answers that are missing."""
    output = target.run(script, root=user_id == 0, bound_s=ACT_BOUND_S)
    return set(output.stdout.splitlines())
