"""`controllers`: all five controllers are active; if not, auto-home restores them and moves the arm home."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lupin_cli.connection.base import Output, Script, Target
from lupin_cli.operations.base import Difference, Operation
from lupin_cli.operations.controller_states import controllers_probe, find_inactive, parse_controllers
from lupin_cli.operations.shell import change
from lupin_cli.systemd.units import AUTO_HOME


@dataclass(frozen=True, kw_only=True)
class Controllers(Operation):
    """A change moves the arm; there is nothing to undo."""

    name: ClassVar[str] = "controllers"
    effect: ClassVar[str] = "all five controllers are active; a change moves the arm home"
    settle_s: ClassVar[float] = 30.0

    @property
    def inspect_command(self) -> str:
        return f"journalctl -u {AUTO_HOME} -u mirte-ros -n 50 --no-pager"

    def probe(self) -> Script:
        return controllers_probe()

    def judge(self, output: Output) -> Difference | None:
        inactive = find_inactive(parse_controllers(output))
        return Difference(f"activate the controllers: {'; '.join(inactive)}", _as_removed_lines(inactive)) if inactive else None

    def change(self, target: Target, difference: Difference) -> None:
        # systemd does not restart a failed oneshot by itself, and counts one that succeeded as running.
        script = f"systemctl reset-failed {AUTO_HOME} 2>/dev/null\nsystemctl restart {AUTO_HOME}"
        change(target, script, "activate the controllers", root=True, timeout_s=300.0, next_command=self.inspect_command)


def _as_removed_lines(lines: list[str]) -> str:
    return "\n".join(f"-{line}" for line in lines)
