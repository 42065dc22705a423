"""`controllers`: all five are active; where they aren't, auto-home heals them and sends the arm home."""

from __future__ import annotations

from typing import Any, ClassVar

from lupin_cli.operations.base import Difference
from lupin_cli.operations.controller_list import complaints, controller_states
from lupin_cli.operations.shell import change
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Target

AUTO_HOME = "lupin-auto-home.service"


@dataclass(frozen=True, kw_only=True)
class Controllers:
    """The arm moves. Healing a healthy robot does nothing, and there is nothing to take back."""

    name: ClassVar[str] = "controllers"
    settle_s: ClassVar[float] = 30.0

    machine: str = "robot"

    @property
    def look_command(self) -> str:
        return f"journalctl -u {AUTO_HOME} -u mirte-ros -n 50 --no-pager"

    def differs(self, target: Target) -> Difference | None:
        wrong = complaints(controller_states(target))
        return (
            Difference(f"controllers are healed: {'; '.join(wrong)}", "\n".join(f"-{w}" for w in wrong), {}) if wrong else None
        )

    def change(self, target: Target, difference: Difference) -> None:
        # A failed oneshot isn't started again by itself, and one that has ended well counts as running.
        script = f"systemctl reset-failed {AUTO_HOME} 2>/dev/null\nsystemctl restart {AUTO_HOME}"
        change(target, script, "heal the controllers", root=True, bound_s=300.0, next_command=self.look_command)

    def undo(self, target: Target, before: dict[str, Any]) -> None:
        """Nothing."""
