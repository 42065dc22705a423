"""`restart`: a unit is started anew, so that it reads what changed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar

from lupin_cli.operations.base import Difference
from lupin_cli.operations.shell import change, quote, read
from lupin_cli.operations.unit import check_unit_name
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Target


@dataclass(frozen=True, kw_only=True)
class Restart:
    """Always differs until it was restarted since this step began: its `when` says whether that is needed.

    A unit that doesn't run isn't started, unless `start` says so.
    """

    name: ClassVar[str] = "restart"
    settle_s: ClassVar[float] = 20.0
    undo_last: ClassVar[bool] = True

    unit: str
    start: bool = False
    machine: str = "robot"
    _old: str = ""  # its invocation when the step began

    def __post_init__(self) -> None:
        check_unit_name(self.unit)

    @property
    def look_command(self) -> str:
        return f"journalctl -u {self.unit} -n 50 --no-pager"

    def begun(self, before: dict[str, Any]) -> Restart:
        return replace(self, _old=before["invocation"] or "none")

    def differs(self, target: Target) -> Difference | None:
        script = f"systemctl show -p ActiveState,InvocationID -- {quote(self.unit)}"
        lines = read(target, script, f"the state of {self.unit}").splitlines()
        now = dict(line.split("=", 1) for line in lines if "=" in line)
        active, invocation = now.get("ActiveState", ""), now.get("InvocationID", "")
        if active in ("inactive", "failed") and not self.start:
            return None
        if self._old and active == "active" and invocation != self._old:
            return None
        return Difference(f"{self.unit} is restarted ({active})", "", {"invocation": invocation})

    def change(self, target: Target, difference: Difference) -> None:
        unit = quote(self.unit)
        script = f"systemctl reset-failed -- {unit} 2>/dev/null\nsystemctl restart -- {unit}"
        change(target, script, f"restart {self.unit}", root=True, bound_s=300.0, next_command=self.look_command)

    def undo(self, target: Target, before: dict[str, Any]) -> None:
        """Once more: what it read has been taken back, and it has to read that too."""
        change(target, f"systemctl try-restart -- {quote(self.unit)}", f"restart {self.unit}", root=True, bound_s=300.0)
