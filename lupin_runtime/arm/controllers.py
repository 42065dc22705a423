"""What it takes to bring the vendor's controllers to `active`, from what the controller manager lists."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

ACTIVE = "active"
UNCONFIGURED = "unconfigured"
FINALIZED = "finalized"


@dataclass(frozen=True)
class Healing:
    """The next thing to do: at most one kind of call at a time, since each changes what the manager lists."""

    load: tuple[str, ...] = ()
    configure: tuple[str, ...] = ()
    activate: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.load or self.configure or self.activate)


def next_step(states: Mapping[str, str], targets: Iterable[str]) -> Healing:
    """What to do next so that every target is active: load those missing, then configure, then activate.

    A finalized controller is left alone; only its unloading would help, and that is not ours to do.
    """
    targets = tuple(targets)
    load = tuple(name for name in targets if name not in states)
    if load:
        return Healing(load=load)
    configure = tuple(name for name in targets if states[name] == UNCONFIGURED)
    if configure:
        return Healing(configure=configure)
    return Healing(activate=tuple(name for name in targets if states[name] not in (ACTIVE, FINALIZED)))


def complaints(states: Mapping[str, str], targets: Iterable[str]) -> tuple[str, ...]:
    """Per target that is not active, what it is instead. A missing one is a failure like any other."""
    return tuple(f"{name} is {states.get(name, 'not loaded')}" for name in targets if states.get(name) != ACTIVE)
