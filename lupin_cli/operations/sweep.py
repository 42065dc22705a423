"""`sweep`: what dead ROS processes left behind is gone: the zombies themselves, and shared memory that nobody holds."""

from __future__ import annotations

import os
from typing import Any, ClassVar

from lupin_cli.operations.base import Difference, OperationError
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Target


def _who(machine: str) -> dict[str, Any]:
    """As whom to look: root on a robot, ourselves here."""
    if machine == "robot":
        return {"user_id": 0}
    from lupin_cli.commands.sweep import live_run_processes

    return {"user_id": os.geteuid(), "runs": live_run_processes(), "ourselves": frozenset({os.getpid()})}


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """What lives, is a service's, or belongs to someone at a terminal is left alone. There is nothing to take back."""

    name: ClassVar[str] = "sweep"
    reports: ClassVar[tuple[str, ...]] = ("blocked",)

    machine: str = "robot"

    def differs(self, target: Target) -> Difference | None:
        from lupin_cli.sweep import look

        plan = look(target, **_who(self.machine))
        if plan.clean:
            return None
        lines = [f"-process {culprit.pid} {culprit.name}: {culprit.why}" for culprit in plan.culprits]
        lines += [f"-/dev/shm/{file}" for orphan in plan.orphans for file in orphan.files]
        summary = f"{len(plan.culprits)} processes are ended, {len(plan.orphans)} segments removed that nobody holds"
        return Difference(summary, "\n".join(lines), {"swept": lines})

    def change(self, target: Target, difference: Difference) -> None:
        from lupin_cli.sweep import sweep

        result = sweep(target, **_who(self.machine))
        if result.failed:
            raise OperationError(f"{target.name}: {'; '.join(result.failed)}", "lupin sweep --dry-run")

    def report(self, target: Target) -> dict[str, Any]:
        from lupin_cli.sweep import look

        return {"blocked": [f"{kept.what}: {kept.why}" for kept in look(target, **_who(self.machine)).kept if kept.blocks]}

    def undo(self, target: Target, before: dict[str, Any]) -> None:
        """Nothing: what was swept was nobody's."""
