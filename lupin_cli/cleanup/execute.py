"""Cleans up a target: gathers facts, terminates stale processes by PID, removes stale files while holding their lock."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from lupin_cli.cleanup.plan import CleanupPlan, Kept, StaleProcess, StaleSegment, make_plan
from lupin_cli.cleanup.process_tree import PROCESS_TREE
from lupin_cli.connection.base import Script, Target, TargetError
from lupin_cli.facts.base import Fact, Value
from lupin_cli.facts.ros_processes import ROS_PROCESSES
from lupin_cli.facts.shared_memory import SHARED_MEMORY
from lupin_cli.facts.sockets import SOCKETS
from lupin_cli.printed_commands import lupin

PROBE_TIMEOUT_S = 15.0
CHANGE_TIMEOUT_S = 60.0
_FACTS: tuple[Fact[Any], ...] = (ROS_PROCESSES, SOCKETS, SHARED_MEMORY, PROCESS_TREE)

# The kernel may have reused a PID since the probe, so the start time is compared before every signal.
_TERMINATE = r"""start_of() { sed 's/.*) //' "/proc/$1/stat" 2>/dev/null | cut -d' ' -f20; }
same() { [ "$(start_of "$1")" = "$2" ] && ! grep -q '^State:.Z' "/proc/$1/status" 2>/dev/null; }
terminate() {
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
# A live owner holds the lock, so its files stay. While this script holds the lock, no process can start to use the files.
# Everybody may write in /dev/shm: `flock FILE` would follow a link and create the file that it points to.
_REMOVE = r"""cd /dev/shm || exit 1
remove() { lock=$1; shift
  if [ -z "$lock" ]; then rm -f -- "$@"
  elif [ -f "$lock" ] && [ ! -L "$lock" ]; then ( flock -n -x 9 && rm -f -- "$@" ) 9<"$lock"; fi
  for file; do [ -e "$file" ] && { echo "stays $1"; return; }; done
  echo "removed $1"
}
"""


@dataclass(frozen=True)
class CleanupResult:
    """What a cleanup terminated and removed, what it kept, and one line for each failure."""

    terminated: tuple[StaleProcess, ...]
    removed: tuple[StaleSegment, ...]
    kept: tuple[Kept, ...]
    failures: tuple[str, ...]


def find_stale(
    target: Target, *, user_id: int, runs: Mapping[int, str] | None = None, own_pids: frozenset[int] = frozenset()
) -> CleanupPlan:
    """Plan the cleanup of `target`; change nothing. Probes run as root if `user_id` is 0. Raises TargetError.

    See `make_plan` for `runs` and `own_pids`.
    """
    scripts = [Script(fact.name, fact.probe, fact.timeout_s, root=user_id == 0) for fact in _FACTS]
    outputs = target.batch(scripts, timeout_s=PROBE_TIMEOUT_S)

    def value(fact: Fact[Value]) -> Value:
        try:
            return fact.parse(outputs[fact.name])
        except ValueError as error:
            raise TargetError(f"{target.name}: {fact.name} cannot be read: {error}", _doctor(target)) from error

    processes, sockets, files, tree = value(ROS_PROCESSES), value(SOCKETS), value(SHARED_MEMORY), value(PROCESS_TREE)
    return make_plan(processes, sockets, files, tree, user_id=user_id, runs=runs, own_pids=own_pids)


def clean_up(
    target: Target, *, user_id: int, runs: Mapping[int, str] | None = None, own_pids: frozenset[int] = frozenset()
) -> CleanupResult:
    """Terminate and remove what `find_stale` finds. Raises TargetError.

    Processes are terminated first; the plan is then made again, since their shared memory has become stale.
    """
    plan = find_stale(target, user_id=user_id, runs=runs, own_pids=own_pids)
    processes, answers = plan.processes, set()
    if processes:
        lines = [f"terminate {process.pid} {process.start_ticks} &" for process in processes]
        answers |= _run(target, _TERMINATE + "\n".join([*lines, "wait"]), user_id)
        plan = find_stale(target, user_id=user_id, runs=runs, own_pids=own_pids)
    if plan.segments:
        lines = [shlex.join(["remove", segment.lock, *segment.files]) for segment in plan.segments]
        answers |= _run(target, _REMOVE + "\n".join(lines), user_id)
    terminated = tuple(process for process in processes if f"ended {process.pid}" in answers)
    removed = tuple(segment for segment in plan.segments if f"removed {segment.files[0]}" in answers)
    failures = [f"{each.name} ({each.pid}) could not be terminated" for each in processes if each not in terminated]
    failures += [f"{each.files[0]} could not be removed: it is in use by now" for each in plan.segments if each not in removed]
    return CleanupResult(terminated, removed, plan.kept, tuple(failures))


def _run(target: Target, script: str, user_id: int) -> set[str]:
    """Run a script and return its output lines. If the connection breaks, lines are missing and their items count as failed."""
    output = target.run(script, root=user_id == 0, timeout_s=CHANGE_TIMEOUT_S)
    return set(output.stdout.splitlines())


def _doctor(target: Target) -> str:
    return lupin("doctor", robot=target.name) if target.login_command else lupin("doctor", "--local")
