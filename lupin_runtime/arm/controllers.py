"""Decides which calls activate the vendor's controllers, from the controller manager's list."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from lupin_runtime import graph

ARM_ACTIONS = (graph.GRIPPER_COMMAND.name, graph.ARM_FOLLOW_TRAJECTORY.name)  # of the vendor's controllers of arm and gripper
ACTIVE = "active"
UNCONFIGURED = "unconfigured"
FINALIZED = "finalized"


@dataclass(frozen=True)
class ActivationStep:
    """The next calls. Only one field is set, because each kind of call changes the manager's list."""

    load: tuple[str, ...] = ()
    configure: tuple[str, ...] = ()
    activate: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.load or self.configure or self.activate)


def next_step(states: Mapping[str, str], targets: Iterable[str]) -> ActivationStep:
    """Return the next step towards active targets: load the missing ones, then configure, then activate.

    A finalized controller is skipped: it could only be unloaded, which is left to the vendor's software.
    """
    targets = tuple(targets)
    load = tuple(name for name in targets if name not in states)
    if load:
        return ActivationStep(load=load)
    configure = tuple(name for name in targets if states[name] == UNCONFIGURED)
    if configure:
        return ActivationStep(configure=configure)
    return ActivationStep(activate=tuple(name for name in targets if states[name] not in (ACTIVE, FINALIZED)))


def inactive_controllers(states: Mapping[str, str], targets: Iterable[str]) -> tuple[str, ...]:
    """Return a phrase for every target that is not active, with its state. A missing controller is not active."""
    return tuple(f"{name} is {states.get(name, 'not loaded')}" for name in targets if states.get(name) != ACTIVE)
