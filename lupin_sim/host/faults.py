"""Everything that can be broken, as a table: what it is, how it is done, how it is taken back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lupin_sim.host.machine import NspawnMachine
from lupin_sim.host.wire import Wire


class FaultError(Exception):
    """There is no such fault, or it cannot be made as things stand."""


Settings = Mapping[str, Any]
Act = Callable[["Bench", NspawnMachine, Settings], None]


@dataclass(frozen=True)
class Fault:
    """One row. `undo` is None for what is over once it happened."""

    summary: str
    do: Act
    undo: Act | None
    settings: Mapping[str, Any] = field(default_factory=dict)  # those it takes, with their defaults


class Bench:
    """Where faults are made: the wire and the robots, and which faults stand."""

    def __init__(self, wire: Wire, machines: list[NspawnMachine], root: Path) -> None:
        self.wire, self.machines, self.root = wire, machines, root
        self._active: dict[tuple[int, str], Settings] = {}

    def apply(self, machine: NspawnMachine, name: str, settings: Settings, undo: bool) -> None:
        """Make a fault, or take it back. Raises FaultError."""
        fault = FAULTS.get(name)
        if fault is None:
            raise FaultError(f"there is no fault {name!r}; there are: {', '.join(sorted(FAULTS))}")
        if unknown := sorted(set(settings) - set(fault.settings)):
            takes = ", ".join(fault.settings) or "no settings"
            raise FaultError(f"{name} knows no {', '.join(unknown)}; it takes {takes}")
        where = (machine.identity.index, name)
        if not undo:
            chosen = {**fault.settings, **settings}
            fault.do(self, machine, chosen)
            if fault.undo is not None:
                self._active[where] = chosen
            return
        if fault.undo is None:
            raise FaultError(f"{name} is over once it happened: there is nothing to undo")
        fault.undo(self, machine, self._active.pop(where, {**fault.settings, **settings}))

    def active(self, machine: NspawnMachine) -> list[str]:
        """The faults that stand."""
        return [name for index, name in self._active if index == machine.identity.index]

    def forget(self, machine: NspawnMachine) -> None:
        """Take back all that would outlive a new disk and a new boot: what was done to the wire."""
        for name in self.active(machine):
            settings = self._active.pop((machine.identity.index, name))
            fault = FAULTS[name]
            if name in OUTSIDE and fault.undo is not None:
                fault.undo(self, machine, settings)


def _cable(is_cut: bool) -> Act:
    return lambda bench, machine, settings: bench.wire.cut(machine.identity, settings["link"], is_cut)


LINK = {"link": "eth0"}
FAULTS: dict[str, Fault] = {
    "cable-cut": Fault("the cable is pulled: both ends lose their carrier", _cable(True), _cable(False), LINK),
}
# Those that are made outside of the robot, so that neither a new disk nor a boot takes them back.
OUTSIDE = {"cable-cut"}


def listing() -> list[dict[str, Any]]:
    """All faults, for those who choose one: name, summary, settings with their defaults, whether it can be taken back."""
    return [
        {"name": name, "summary": fault.summary, "settings": dict(fault.settings), "undo": fault.undo is not None}
        for name, fault in sorted(FAULTS.items())
    ]


def parse(name: str, assignments: list[str]) -> dict[str, Any]:
    """Settings out of SETTING=VALUE, each of the kind of its default. Raises FaultError."""
    fault = FAULTS.get(name)
    if fault is None:
        raise FaultError(f"there is no fault {name!r}; there are: {', '.join(sorted(FAULTS))}")
    chosen: dict[str, Any] = {}
    for assignment in assignments:
        key, _, text = assignment.partition("=")
        if key not in fault.settings:
            raise FaultError(f"{name} knows no {key!r}; it takes {', '.join(fault.settings) or 'no settings'}")
        default = fault.settings[key]
        try:
            chosen[key] = type(default)(text)
        except ValueError:
            raise FaultError(f"{key} of {name} is a number like {default}, and {text!r} is not") from None
    return chosen
