"""`unit`: a systemd unit that is started or stopped, enabled or disabled, masked or not."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from lupin_cli.connection.base import Output, Script, Target
from lupin_cli.operations.base import Difference, Operation, OperationError, probe_script
from lupin_cli.operations.shell import change, key_values, quote

_UNIT_NAME = re.compile(r"[A-Za-z0-9:_.@\\-]+\.(service|socket|timer|target|path|mount)\Z")
_PROPERTIES = ("LoadState", "ActiveState", "UnitFileState", "Type", "RemainAfterExit")


def check_unit_name(unit: str) -> None:
    """Raise ValueError unless `unit` can name a unit."""
    if not _UNIT_NAME.match(unit):
        raise ValueError(f"a unit's name must end in .service, .timer or the like: {unit!r}")


@dataclass(frozen=True, kw_only=True)
class Unit(Operation):
    """Examines and sets only the arguments that are given. A unit that does not exist counts as stopped and disabled.

    A oneshot that succeeded counts as started if it has RemainAfterExit. The state `failed` is reset before a start, since
    systemd would go on counting failures. `masked: false` is applied before `enabled` and `state`.
    """

    name: ClassVar[str] = "unit"
    effect: ClassVar[str] = "a systemd unit is started or stopped, enabled or disabled, masked or not"
    undo_effect: ClassVar[str] = "yes"
    prefetchable: ClassVar[bool] = True
    settle_s: ClassVar[float] = 20.0
    report_keys: ClassVar[tuple[str, ...]] = ("active", "enabled", "loaded")

    unit: str
    state: Literal["started", "stopped"] | None = None
    enabled: bool | None = None
    masked: bool | None = None
    reset_failed: bool = False

    def __post_init__(self) -> None:
        check_unit_name(self.unit)
        if self.state is None and self.enabled is None and self.masked is None and not self.reset_failed:
            raise ValueError("it needs one of: state, enabled, masked, reset_failed")
        if self.masked and (self.state == "started" or self.enabled):
            raise ValueError("a masked unit cannot be started or enabled")

    @property
    def inspect_command(self) -> str:
        return f"journalctl -u {self.unit} -n 50 --no-pager"

    def probe(self) -> Script:
        return probe_script(f"systemctl show -p {','.join(_PROPERTIES)} -- {quote(self.unit)}")

    def _properties(self, output: Output) -> dict[str, str]:
        properties = key_values(output, f"the state of {self.unit}")
        if "LoadState" not in properties or "ActiveState" not in properties:
            raise OperationError(f"could not read the state of {self.unit}: found {output.stdout[:80]!r}", self.inspect_command)
        return properties

    def judge(self, output: Output) -> Difference | None:
        properties = self._properties(output)
        active, enabled, load = properties["ActiveState"], properties.get("UnitFileState", ""), properties["LoadState"]
        if load == "not-found":
            if self.state == "started" or self.enabled:
                raise OperationError(f"the {self.machine} has no unit {self.unit}", "lupin deploy robot")
            if not self.masked:
                return None
        changes = []
        if self.masked is not None and (load == "masked") != self.masked:
            changes.append("mask" if self.masked else "unmask")
        if self.enabled is not None and enabled in ("enabled", "disabled", "") and (enabled == "enabled") != self.enabled:
            changes.append("enable" if self.enabled else "disable")
        if self.reset_failed and active == "failed":
            changes.append("reset its failure")
        if self.state == "started" and active != "active":
            changes.append(f"start (now {active})")
        if self.state == "stopped" and active not in ("inactive", "failed"):
            changes.append(f"stop (now {active})")
        if not changes:
            return None
        before = {"active": active in ("active", "activating", "reloading"), "enabled": enabled, "masked": load == "masked"}
        return Difference(f"{self.unit}: {', '.join(changes)}", "", before)

    def change(self, target: Target, difference: Difference) -> None:
        unit = quote(self.unit)
        lines = []
        if self.masked is not None:
            lines.append(f"systemctl {'mask' if self.masked else 'unmask'} --quiet -- {unit}")
        if self.enabled is not None:
            lines.append(f"systemctl {'enable' if self.enabled else 'disable'} --quiet -- {unit}")
        if self.reset_failed or self.state == "started":
            lines.append(f"systemctl reset-failed -- {unit} 2>/dev/null || :")
        if self.state == "stopped":
            lines.append(f"systemctl stop -- {unit}")
        if self.state == "started":
            lines.append(f"systemctl start -- {unit}")
        script = "set -e\n" + "\n".join(lines)
        change(target, script, f"set {self.unit}", root=True, timeout_s=300.0, next_command=self.inspect_command)

    def report(self, output: Output) -> dict[str, Any]:
        properties = self._properties(output)
        return {
            "active": properties["ActiveState"] == "active",
            "enabled": properties.get("UnitFileState") == "enabled",
            "loaded": properties["LoadState"] == "loaded",
        }

    def undo(self, target: Target, before: Mapping[str, Any]) -> None:
        unit = quote(self.unit)
        lines = []
        if self.masked is not None:
            lines.append(f"systemctl {'mask' if before['masked'] else 'unmask'} --quiet -- {unit}")
        if self.enabled is not None and before["enabled"] in ("enabled", "disabled"):
            lines.append(f"systemctl {before['enabled'].removesuffix('d')} --quiet -- {unit}")
        if self.state is not None:
            lines.append(f"systemctl {'start' if before['active'] else 'stop'} -- {unit}")
        if lines:
            script = "set -e\n" + "\n".join(lines)
            change(target, script, f"restore {self.unit}", root=True, timeout_s=300.0, next_command=self.inspect_command)
