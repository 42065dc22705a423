"""The states and transitions of the mission's hierarchical state machine (HSM), as plain data.

The data needs neither ROS nor the `transitions` package, so diagrams can be drawn from it on any machine.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

SEPARATOR = "."

Trigger = Literal[
    "deps_up",
    "start_mission",
    "localized",
    "tags_discovered",
    "no_frontiers",
    "nav_succeeded",
    "nav_unreachable",
    "scan_done",
    "next_tag",
    "inspection_complete",
    "abort_to_return",
    "returned",
    "resume_inspection",
    "resume_monitoring",
    "resume_exploration",
    "reset_for_next",
    "recover",
    "fault",
]

BOOT, READY, PREPARE, EXPLORING, INSPECTING, MONITORING, RETURNING, DONE, FAULT = (
    "BOOT",
    "READY",
    "PREPARE",
    "EXPLORING",
    "INSPECTING",
    "MONITORING",
    "RETURNING",
    "DONE",
    "FAULT",
)
LOCALIZING, NAVIGATING, SCANNING, PUBLISHING = "LOCALIZING", "NAVIGATING", "SCANNING", "PUBLISHING"

BUSY = frozenset({PREPARE, EXPLORING, INSPECTING, MONITORING, RETURNING})
"""Top-level states of a mission in progress."""

RESUMABLE = frozenset({EXPLORING, INSPECTING, MONITORING})
"""Top-level states that a mission can resume after a return to the dock."""

RESUME_TRIGGER: dict[str, Trigger] = {
    INSPECTING: "resume_inspection",
    MONITORING: "resume_monitoring",
    EXPLORING: "resume_exploration",
}


@dataclass(frozen=True)
class StateSpec:
    """A top-level state. A composite state lists its leaves and names the initial one."""

    name: str
    children: tuple[str, ...] = ()
    initial: str | None = None
    note: str = ""


@dataclass(frozen=True)
class TransitionSpec:
    """`trigger` leads from any of `sources` to `dest`; `guard` names the condition that must hold, or is ""."""

    trigger: Trigger
    sources: tuple[str, ...]
    dest: str
    guard: str = ""
    note: str = ""


@dataclass(frozen=True)
class HsmSpec:
    """The complete state machine. A leaf has no substates; a leaf of a composite state is named `COMPOSITE.SUBSTATE`."""

    initial: str
    states: tuple[StateSpec, ...]
    transitions: tuple[TransitionSpec, ...]

    def leaves(self) -> tuple[str, ...]:
        """Return every leaf state; a composite state is replaced by its leaves."""
        return tuple(
            leaf
            for state in self.states
            for leaf in ([SEPARATOR.join((state.name, child)) for child in state.children] or [state.name])
        )

    def leaf_of(self, state: str) -> str:
        """Return the leaf that is active after entering `state`."""
        spec = next((s for s in self.states if s.name == state), None)
        return state if spec is None or spec.initial is None else SEPARATOR.join((state, spec.initial))

    def destinations(self, trigger: str, leaf: str) -> tuple[TransitionSpec, ...]:
        """Return the transitions that `trigger` may take from a leaf; empty if none is declared."""
        return tuple(
            t
            for t in self.transitions
            if t.trigger == trigger and any(leaf == s or leaf.startswith(s + SEPARATOR) for s in t.sources)
        )


def _leaf(composite: str, child: str) -> str:
    return SEPARATOR.join((composite, child))


def build_hsm_spec() -> HsmSpec:
    """Return the states and transitions of the mission."""
    visit = (NAVIGATING, SCANNING, PUBLISHING)
    states = (
        StateSpec(BOOT, note="wait for navigation and the bridge"),
        StateSpec(READY, note="wait for a start"),
        StateSpec(PREPARE, (LOCALIZING,), LOCALIZING, "wait for a pose that can be trusted"),
        StateSpec(EXPLORING, note="frontiers, then unseen surfaces"),
        StateSpec(INSPECTING, visit, NAVIGATING, "a list of tags, once"),
        StateSpec(MONITORING, visit, NAVIGATING, "the discovered tags, round after round"),
        StateSpec(RETURNING, note="drive to the dock"),
        StateSpec(DONE),
        StateSpec(FAULT),
    )
    composites = (INSPECTING, MONITORING)
    transitions: list[TransitionSpec] = [
        TransitionSpec("deps_up", (BOOT,), READY),
        TransitionSpec("start_mission", (READY,), PREPARE),
        TransitionSpec("localized", (_leaf(PREPARE, LOCALIZING),), EXPLORING, "is_exploration"),
        TransitionSpec("localized", (_leaf(PREPARE, LOCALIZING),), INSPECTING, "is_inspection"),
        TransitionSpec("tags_discovered", (EXPLORING,), MONITORING),
        TransitionSpec("no_frontiers", (EXPLORING,), MONITORING, "has_discovered_tags"),
        TransitionSpec("no_frontiers", (EXPLORING,), RETURNING, "has_no_tags"),
    ]
    for composite in composites:
        transitions += [
            TransitionSpec("nav_succeeded", (_leaf(composite, NAVIGATING),), _leaf(composite, SCANNING)),
            TransitionSpec("nav_unreachable", (_leaf(composite, NAVIGATING),), _leaf(composite, PUBLISHING)),
            TransitionSpec("scan_done", (_leaf(composite, SCANNING),), _leaf(composite, PUBLISHING)),
            TransitionSpec("next_tag", (_leaf(composite, PUBLISHING),), _leaf(composite, NAVIGATING)),
            TransitionSpec("inspection_complete", (_leaf(composite, PUBLISHING),), RETURNING),
        ]
    divertible = (
        PREPARE,
        _leaf(PREPARE, LOCALIZING),
        EXPLORING,
        *(_leaf(composite, child) for composite in composites for child in visit),
    )
    transitions += [
        TransitionSpec("abort_to_return", divertible, RETURNING),
        TransitionSpec("returned", (RETURNING,), DONE),
        TransitionSpec("resume_inspection", (RETURNING,), INSPECTING),
        TransitionSpec("resume_monitoring", (RETURNING,), MONITORING),
        TransitionSpec("resume_exploration", (RETURNING,), EXPLORING),
        TransitionSpec("reset_for_next", (DONE,), READY),
        TransitionSpec("recover", (FAULT,), READY),
        TransitionSpec("fault", (BOOT, READY, PREPARE, EXPLORING, INSPECTING, MONITORING, RETURNING), FAULT, note="timeout"),
    ]
    return HsmSpec(BOOT, states, tuple(transitions))
