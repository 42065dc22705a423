"""`restart`: restart a unit, so that it reads what changed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from lupin_cli.connection.base import Output, Script, Target
from lupin_cli.operations.base import Difference, Operation, OperationError, probe_script
from lupin_cli.operations.shell import change, key_values, quote
from lupin_cli.operations.unit import check_unit_name

_NEVER_STARTED = "none"


@dataclass(frozen=True, kw_only=True)
class Restart(Operation):
    """Finds a difference until the unit has restarted in this step; the step's `when` says whether that is needed.

    A unit that does not run is not started, unless `start` is true.
    """

    name: ClassVar[str] = "restart"
    effect: ClassVar[str] = "a unit was restarted in this step"
    undo_effect: ClassVar[str] = "restarted again, after all other steps are undone"
    settle_s: ClassVar[float] = 20.0
    undo_last: ClassVar[bool] = True

    unit: str
    start: bool = False
    _invocation_before: str = ""  # the unit's systemd invocation id when the step began

    def __post_init__(self) -> None:
        check_unit_name(self.unit)

    @property
    def inspect_command(self) -> str:
        return f"journalctl -u {self.unit} -n 50 --no-pager"

    def with_baseline(self, before: Mapping[str, Any]) -> Restart:
        return replace(self, _invocation_before=before["invocation"] or _NEVER_STARTED)

    def probe(self) -> Script:
        return probe_script(f"systemctl show -p ActiveState,InvocationID -- {quote(self.unit)}")

    def judge(self, output: Output) -> Difference | None:
        values = key_values(output, f"the state of {self.unit}")
        if "ActiveState" not in values:
            raise OperationError(f"could not read the state of {self.unit}: found {output.stdout[:80]!r}", self.inspect_command)
        active, invocation = values["ActiveState"], values.get("InvocationID", "")
        if active in ("inactive", "failed") and not self.start:
            return None
        if self._invocation_before and active == "active" and invocation != self._invocation_before:
            return None
        return Difference(f"restart {self.unit} ({active})", "", {"invocation": invocation})

    def change(self, target: Target, difference: Difference) -> None:
        unit = quote(self.unit)
        script = f"systemctl reset-failed -- {unit} 2>/dev/null\nsystemctl restart -- {unit}"
        change(target, script, f"restart {self.unit}", root=True, timeout_s=300.0, next_command=self.inspect_command)

    def undo(self, target: Target, before: Mapping[str, Any]) -> None:
        """Restart the unit again, so that it reads what the undo of other steps restored."""
        change(target, f"systemctl try-restart -- {quote(self.unit)}", f"restart {self.unit}", root=True, timeout_s=300.0)
