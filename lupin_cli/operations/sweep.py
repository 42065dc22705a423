"""`sweep`: remove what dead ROS processes left behind: stale processes, and shared memory that no process uses."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any, ClassVar, TypedDict

from lupin_cli.cleanup.execute import clean_up
from lupin_cli.cleanup.live_runs import live_run_processes
from lupin_cli.cleanup.plan import CleanupPlan, make_plan
from lupin_cli.cleanup.process_tree import PROCESS_TREE
from lupin_cli.connection.base import Output, Script, Target
from lupin_cli.facts.ros_processes import ROS_PROCESSES
from lupin_cli.facts.shared_memory import SHARED_MEMORY
from lupin_cli.facts.shared_shell import join_probes, split_outputs
from lupin_cli.facts.sockets import SOCKETS
from lupin_cli.operations.base import Difference, Operation, OperationError, probe_script

_PROBES = tuple(fact.probe for fact in (ROS_PROCESSES, SOCKETS, SHARED_MEMORY, PROCESS_TREE))
_TIMEOUT_S = 15.0


class _Owner(TypedDict, total=False):
    """The user who cleans up: root on a robot; on the laptop this user, whose live runs and this process are spared."""

    user_id: int
    runs: dict[int, str]
    own_pids: frozenset[int]


@dataclass(frozen=True, kw_only=True)
class Sweep(Operation):
    """Spares what is alive, belongs to a service, or was started from a terminal. There is nothing to undo."""

    name: ClassVar[str] = "sweep"
    effect: ClassVar[str] = "there are no stale ROS processes and no shared memory that no process uses"
    report_keys: ClassVar[tuple[str, ...]] = ("blocked",)

    def _owner(self) -> _Owner:
        if self.machine == "robot":
            return {"user_id": 0}
        return {"user_id": os.geteuid(), "runs": live_run_processes(), "own_pids": frozenset({os.getpid()})}

    def probe(self) -> Script:
        return probe_script(join_probes(_PROBES), root=self.machine == "robot" or os.geteuid() == 0, timeout_s=_TIMEOUT_S)

    def _plan(self, output: Output) -> CleanupPlan:
        processes, sockets, files, tree = split_outputs(output, _PROBES)
        try:
            return make_plan(
                ROS_PROCESSES.parse(processes),
                SOCKETS.parse(sockets),
                SHARED_MEMORY.parse(files),
                PROCESS_TREE.parse(tree),
                **self._owner(),
            )
        except ValueError as error:
            raise OperationError(f"could not read the processes and shared memory: {error}", "lupin doctor") from error

    def judge(self, output: Output) -> Difference | None:
        plan = self._plan(output)
        if plan.is_empty:
            return None
        lines = [f"-process {process.pid} {process.name}: {process.reason}" for process in plan.processes]
        lines += [f"-/dev/shm/{file}" for segment in plan.segments for file in segment.files]
        summary = f"terminate {len(plan.processes)} stale processes, remove {len(plan.segments)} unused segments"
        return Difference(summary, "\n".join(lines), {"swept": lines})

    def change(self, target: Target, difference: Difference) -> None:
        result = clean_up(target, **self._owner())
        if result.failures:
            raise OperationError(f"{target.name}: {'; '.join(result.failures)}", "lupin sweep --dry-run")

    def report(self, output: Output) -> dict[str, Any]:
        return {"blocked": [f"{each.subject}: {each.reason}" for each in self._plan(output).kept if each.needs_root]}
