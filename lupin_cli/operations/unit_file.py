"""`unit-file`: the text of a systemd unit, loaded by systemd."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from lupin_cli.connection.base import Output, Script, Target, TargetError
from lupin_cli.operations.base import Difference, Operation, OperationError, RestoredFile, probe_script
from lupin_cli.operations.path_state import (
    all_of,
    complete_file,
    file_script,
    parse_file,
    remove,
    restore,
    state_before,
    unified_diff,
)
from lupin_cli.operations.shell import change, quote
from lupin_cli.operations.unit import check_unit_name

_FOLDER = "/etc/systemd/system"


@dataclass(frozen=True, kw_only=True)
class UnitFile(Operation):
    """The shipped template of that name with its placeholders filled from `fill`, or `content`. `present: false` removes it.

    The target's own systemd verifies the text before it counts as installed.
    """

    name: ClassVar[str] = "unit-file"
    effect: ClassVar[str] = "a systemd unit has this text, verified and loaded by the target's own systemd, or does not exist"
    undo_effect: ClassVar[str] = "byte for byte"
    prefetchable: ClassVar[bool] = True

    unit: str
    fill: dict[str, Any] = field(default_factory=dict)
    content: str | None = None
    present: bool = True

    def __post_init__(self) -> None:
        check_unit_name(self.unit)
        if self.present:
            self._text()

    @property
    def _path(self) -> str:
        return f"{_FOLDER}/{self.unit}"

    def _text(self) -> str:
        if self.content is not None:
            return self.content
        from lupin_cli.systemd.units import render

        return render(self.unit, self.fill)  # raises UnitError, a ValueError

    def probe(self) -> Script:
        needs_reload = f"systemctl show -p NeedDaemonReload --value -- {quote(self.unit)}"
        return probe_script(file_script(self._path, needs_reload), root=True)

    def complete(self, target: Target, output: Output) -> Output:
        return complete_file(target, output, self._path, True)

    def judge(self, output: Output) -> Difference | None:
        state = parse_file(output, self._path)
        if not self.present:
            if state.kind == "absent":
                return None
            return Difference(f"remove {self.unit}", unified_diff(self._path, state.content, None), state_before(state))
        new = self._text().encode()
        if state.content != new:
            verb = "install" if state.kind == "absent" else "update"
            return Difference(f"{verb} {self.unit}", unified_diff(self._path, state.content, new), state_before(state))
        if state.extra.strip() == "yes":
            return Difference(f"reload systemd, which has an older text of {self.unit}", "", state_before(state))
        return None

    def change(self, target: Target, difference: Difference) -> None:
        if self.present:
            target.put(self._path, self._text().encode(), mode=0o644, root=True)
            # If systemd rejects the unit, the state before is restored, before anything loads the unit.
            try:
                change(target, f"systemd-analyze verify --man=no -- {quote(self._path)}", f"verify {self.unit}", root=True)
            except (OperationError, TargetError):
                restore(target, self._path, difference.before, True)
                raise
        else:
            remove(target, self._path, True)
        _reload_systemd(target)

    def restored_files(self) -> tuple[RestoredFile, ...]:
        return (RestoredFile(self._path, root=True),)

    def overwritten(self, output: Output) -> dict[str, bytes]:
        return {self._path: all_of(parse_file(output, self._path))}

    def undo(self, target: Target, before: Mapping[str, Any]) -> None:
        restore(target, self._path, before, True)
        _reload_systemd(target)


def _reload_systemd(target: Target) -> None:
    change(target, "systemctl daemon-reload", "make systemd reload its units", root=True)
