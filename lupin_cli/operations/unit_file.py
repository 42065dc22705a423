"""`unit-file`: the text of a systemd unit, and a systemd that has read it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import Any, ClassVar

from lupin_cli.operations.base import Difference, OperationError
from lupin_cli.operations.paths import describe, read_file, restore, unified_diff
from lupin_cli.operations.shell import change, quote
from lupin_cli.operations.unit import check_unit_name
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Target, TargetError

FOLDER = "/etc/systemd/system"


@dataclass(frozen=True, kw_only=True)
class UnitFile:
    """A shipped template of that name with its holes filled (`fill`), or `content`; `present: false` removes it.

    The text is checked by the target's own systemd before it counts as installed.
    """

    name: ClassVar[str] = "unit-file"
    stands: ClassVar[bool] = True

    unit: str
    fill: dict[str, Any] = field(default_factory=dict)
    content: str | None = None
    present: bool = True
    machine: str = "robot"

    def __post_init__(self) -> None:
        check_unit_name(self.unit)
        if self.present:
            self._text()

    @property
    def _path(self) -> str:
        return f"{FOLDER}/{self.unit}"

    def _text(self) -> str:
        if self.content is not None:
            return self.content
        from lupin_cli.units import render

        filled: Mapping[str, Any] = self.fill
        return render(self.unit, filled)  # raises UnitError, a ValueError

    def differs(self, target: Target) -> Difference | None:
        stale = f"systemctl show -p NeedDaemonReload --value -- {quote(self.unit)}"
        entry, old, answer = read_file(target, self._path, True, stale)
        if not self.present:
            if entry.kind == "absent":
                return None
            return Difference(f"{self.unit} goes away", unified_diff(self._path, old, None), describe(entry, old))
        new = self._text().encode()
        if old != new:
            what = "is installed" if entry.kind == "absent" else "changes"
            return Difference(f"{self.unit} {what}", unified_diff(self._path, old, new), describe(entry, old))
        if answer.strip() == "yes":
            return Difference(f"systemd reads {self.unit} again", "", describe(entry, old))
        return None

    def change(self, target: Target, difference: Difference) -> None:
        if self.present:
            target.put(self._path, self._text().encode(), mode=0o644, root=True)
            # A unit that systemd can't read is taken out again before anything loads it.
            try:
                change(target, f"systemd-analyze verify --man=no -- {quote(self._path)}", f"verify {self.unit}", root=True)
            except (OperationError, TargetError):
                restore(target, self._path, difference.before, True)
                raise
        else:
            change(target, f"rm -f -- {quote(self._path)}", f"remove {self.unit}", root=True)
        self._reload(target)

    def undo(self, target: Target, before: dict[str, Any]) -> None:
        restore(target, self._path, before, True)
        self._reload(target)

    def _reload(self, target: Target) -> None:
        change(target, "systemctl daemon-reload", "let systemd read its units", root=True)
