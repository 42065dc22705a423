"""`unit`: a systemd unit that runs or doesn't, starts at boot or doesn't."""

from __future__ import annotations

import re
from typing import Any, ClassVar, Literal

from lupin_cli.operations.base import Difference, OperationError
from lupin_cli.operations.shell import change, quote, read
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Target

UNIT_NAME = re.compile(r"[A-Za-z0-9:_.@\\-]+\.(service|socket|timer|target|path|mount)\Z")
_PROPERTIES = ("LoadState", "ActiveState", "UnitFileState", "Type", "RemainAfterExit")


def check_unit_name(unit: str) -> None:
    """Raises ValueError for what can't name a unit."""
    if not UNIT_NAME.match(unit):
        raise ValueError(f"a unit's name ends in .service, .timer and the like, unlike {unit!r}")


@dataclass(frozen=True, kw_only=True)
class Unit:
    """Only what is given is asked for. A unit that isn't there counts as stopped and disabled.

    `state: started` also counts a oneshot that has ended well; `failed` is reset before a start, since systemd would go on
    counting. `masked: false` is undone before `enabled` and `state` are looked at.
    """

    name: ClassVar[str] = "unit"
    stands: ClassVar[bool] = True
    settle_s: ClassVar[float] = 20.0
    reports: ClassVar[tuple[str, ...]] = ("active", "enabled", "loaded")

    unit: str
    state: Literal["started", "stopped"] | None = None
    enabled: bool | None = None
    masked: bool | None = None
    reset_failed: bool = False
    machine: str = "robot"

    def __post_init__(self) -> None:
        check_unit_name(self.unit)
        if self.state is None and self.enabled is None and self.masked is None and not self.reset_failed:
            raise ValueError("what is asked of it: state, enabled, masked or reset_failed?")
        if self.masked and (self.state == "started" or self.enabled):
            raise ValueError("a masked unit can't be started or enabled")

    @property
    def look_command(self) -> str:
        return f"journalctl -u {self.unit} -n 50 --no-pager"

    def _show(self, target: Target) -> dict[str, str]:
        script = f"systemctl show -p {','.join(_PROPERTIES)} -- {quote(self.unit)}"
        text = read(target, script, f"the state of {self.unit}")
        return dict(line.split("=", 1) for line in text.splitlines() if "=" in line)

    def differs(self, target: Target) -> Difference | None:
        now = self._show(target)
        active, enabled, load = now.get("ActiveState", ""), now.get("UnitFileState", ""), now.get("LoadState", "")
        if load == "not-found":
            if self.state == "started" or self.enabled:
                raise OperationError(f"{target.name} has no unit {self.unit}", "lupin deploy robot")
            if not self.masked:
                return None
        changes = []
        if self.masked is not None and (load == "masked") != self.masked:
            changes.append("is masked" if self.masked else "is unmasked")
        if self.enabled is not None and enabled in ("enabled", "disabled", "") and (enabled == "enabled") != self.enabled:
            changes.append("starts at boot" if self.enabled else "no longer starts at boot")
        if self.reset_failed and active == "failed":
            changes.append("is no longer failed")
        if self.state == "started" and active != "active":
            changes.append(f"is started ({active})")
        if self.state == "stopped" and active not in ("inactive", "failed"):
            changes.append(f"is stopped ({active})")
        if not changes:
            return None
        before = {"active": active in ("active", "activating", "reloading"), "enabled": enabled, "masked": load == "masked"}
        return Difference(f"{self.unit} {' and '.join(changes)}", "", before)

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
            # What fails is told by the verification, with what is left of the time for a restart of systemd's own.
            lines.append(f"systemctl start -- {unit}")
        change(
            target, "set -e\n" + "\n".join(lines), f"set {self.unit}", root=True, bound_s=300.0, next_command=self.look_command
        )

    def report(self, target: Target) -> dict[str, Any]:
        now = self._show(target)
        return {
            "active": now.get("ActiveState") == "active",
            "enabled": now.get("UnitFileState") == "enabled",
            "loaded": now.get("LoadState") == "loaded",
        }

    def undo(self, target: Target, before: dict[str, Any]) -> None:
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
            change(target, script, f"put {self.unit} back", root=True, bound_s=300.0, next_command=self.look_command)
