"""The mission's state machine as plain data, and the machine that runs it.

The data needs neither ROS nor the `transitions` package, so that a diagram or a document can be drawn from it anywhere.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from transitions import EventData

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
"""Top-level states in which a mission runs."""

FAMILIES = frozenset({EXPLORING, INSPECTING, MONITORING})
"""States that a return may come back to."""

RESUME_TRIGGER: dict[str, Trigger] = {
    INSPECTING: "resume_inspection",
    MONITORING: "resume_monitoring",
    EXPLORING: "resume_exploration",
}


@dataclass(frozen=True)
class StateSpec:
    """A state; a composite one names its leaves and the one it starts in."""

    name: str
    children: tuple[str, ...] = ()
    initial: str | None = None
    note: str = ""


@dataclass(frozen=True)
class TransitionSpec:
    """`trigger` takes any of `sources` to `dest`; `guard` names the condition that must hold, "" for none."""

    trigger: Trigger
    sources: tuple[str, ...]
    dest: str
    guard: str = ""
    note: str = ""


@dataclass(frozen=True)
class HsmSpec:
    """The whole topology. Names of nested states are joined by dots."""

    initial: str
    states: tuple[StateSpec, ...]
    transitions: tuple[TransitionSpec, ...]

    def leaves(self) -> tuple[str, ...]:
        """Every state that the machine can rest in, composites resolved."""
        return tuple(
            leaf
            for state in self.states
            for leaf in ([SEPARATOR.join((state.name, child)) for child in state.children] or [state.name])
        )

    def leaf_of(self, state: str) -> str:
        """Where entering `state` ends."""
        spec = next((s for s in self.states if s.name == state), None)
        return state if spec is None or spec.initial is None else SEPARATOR.join((state, spec.initial))

    def destinations(self, trigger: str, leaf: str) -> tuple[TransitionSpec, ...]:
        """The transitions that `trigger` may take from a leaf state; empty if it is not declared there."""
        return tuple(
            t
            for t in self.transitions
            if t.trigger == trigger and any(leaf == s or leaf.startswith(s + SEPARATOR) for s in t.sources)
        )


def _leaf(family: str, child: str) -> str:
    return SEPARATOR.join((family, child))


def build_hsm_spec() -> HsmSpec:
    """States and transitions of the mission as data; needs no node and no ROS."""
    visit = (NAVIGATING, SCANNING, PUBLISHING)
    states = (
        StateSpec(BOOT, note="wait for navigation and the bridge"),
        StateSpec(READY, note="wait for a start"),
        StateSpec(PREPARE, (LOCALIZING,), LOCALIZING, "wait for a pose that can be trusted"),
        StateSpec(EXPLORING, note="frontiers, then unseen surfaces"),
        StateSpec(INSPECTING, visit, NAVIGATING, "a list of tags, once"),
        StateSpec(MONITORING, visit, NAVIGATING, "the discovered tags, sweep after sweep"),
        StateSpec(RETURNING, note="drive to the dock"),
        StateSpec(DONE),
        StateSpec(FAULT),
    )
    both = (INSPECTING, MONITORING)
    transitions: list[TransitionSpec] = [
        TransitionSpec("deps_up", (BOOT,), READY),
        TransitionSpec("start_mission", (READY,), PREPARE),
        TransitionSpec("localized", (_leaf(PREPARE, LOCALIZING),), EXPLORING, "explores"),
        TransitionSpec("localized", (_leaf(PREPARE, LOCALIZING),), INSPECTING, "inspects"),
        TransitionSpec("tags_discovered", (EXPLORING,), MONITORING),
        TransitionSpec("no_frontiers", (EXPLORING,), MONITORING, "found_some"),
        TransitionSpec("no_frontiers", (EXPLORING,), RETURNING, "found_none"),
    ]
    for family in both:
        transitions += [
            TransitionSpec("nav_succeeded", (_leaf(family, NAVIGATING),), _leaf(family, SCANNING)),
            TransitionSpec("nav_unreachable", (_leaf(family, NAVIGATING),), _leaf(family, PUBLISHING)),
            TransitionSpec("scan_done", (_leaf(family, SCANNING),), _leaf(family, PUBLISHING)),
            TransitionSpec("next_tag", (_leaf(family, PUBLISHING),), _leaf(family, NAVIGATING)),
            TransitionSpec("inspection_complete", (_leaf(family, PUBLISHING),), RETURNING),
        ]
    divertible = (
        PREPARE,
        _leaf(PREPARE, LOCALIZING),
        EXPLORING,
        *(_leaf(family, child) for family in both for child in visit),
    )
    transitions += [
        TransitionSpec("abort_to_return", divertible, RETURNING),
        TransitionSpec("returned", (RETURNING,), DONE),
        TransitionSpec("resume_inspection", (RETURNING,), INSPECTING),
        TransitionSpec("resume_monitoring", (RETURNING,), MONITORING),
        TransitionSpec("resume_exploration", (RETURNING,), EXPLORING),
        TransitionSpec("reset_for_next", (DONE,), READY),
        TransitionSpec("recover", (FAULT,), READY),
        TransitionSpec("fault", (BOOT, READY, PREPARE, EXPLORING, INSPECTING, MONITORING, RETURNING), FAULT, note="time-out"),
    ]
    return HsmSpec(BOOT, states, tuple(transitions))


class MissionHsm:
    """Runs the topology with queued triggers; a trigger that the current state does not declare is ignored and kept in
    `ignored`, never raised.

    `guards` answers the conditions that transitions name; `on_change(source, dest)` is told of every transition taken,
    with leaf names, before a trigger queued meanwhile is looked at.
    """

    def __init__(
        self,
        guards: dict[str, Callable[[], bool]],
        on_change: Callable[[str, str], None] = lambda source, dest: None,
        spec: HsmSpec | None = None,
    ) -> None:
        from transitions.extensions.nesting import HierarchicalMachine, NestedState

        class _State(NestedState):
            separator = SEPARATOR

        class _Machine(HierarchicalMachine):
            state_cls = _State

        class _Model:
            state: str
            trigger: Callable[[str], bool]

        self.spec = spec or build_hsm_spec()
        self.ignored: list[tuple[str, str]] = []
        self._on_change = on_change
        self._model = _Model()
        self._before = self.spec.initial
        self._machine = _Machine(
            self._model,
            states=[_state_dict(state) for state in self.spec.states],
            transitions=[_transition_dict(t, guards) for t in self.spec.transitions],
            initial=self.spec.initial,
            queued=True,
            ignore_invalid_triggers=True,
            auto_transitions=False,
            send_event=True,
            after_state_change=self._changed,
        )

    def _changed(self, event: EventData) -> None:
        before, self._before = self._before, self.state
        self._on_change(before, self.state)

    @property
    def state(self) -> str:
        """The current leaf, such as `INSPECTING.SCANNING`."""
        return self._model.state

    @property
    def lifecycle(self) -> str:
        """The top-level state."""
        return self.state.split(SEPARATOR)[0]

    @property
    def leaf(self) -> str:
        """The nested state's own name, "" where there is none."""
        return self.state.split(SEPARATOR)[1] if SEPARATOR in self.state else ""

    def fire(self, trigger: Trigger) -> bool:
        """Fire a trigger; False (and a note in `ignored`) if the current state does not declare it."""
        if not self.spec.destinations(trigger, self.state):
            self.ignored.append((self.state, trigger))
            del self.ignored[:-100]
            return False
        return bool(self._model.trigger(trigger))


def _state_dict(state: StateSpec) -> Any:
    if not state.children:
        return state.name
    return {"name": state.name, "children": list(state.children), "initial": state.initial}


def _transition_dict(transition: TransitionSpec, guards: dict[str, Callable[[], bool]]) -> dict[str, Any]:
    built: dict[str, Any] = {
        "trigger": transition.trigger,
        "source": list(transition.sources),
        "dest": transition.dest,
    }
    if transition.guard:
        guard = guards[transition.guard]
        built["conditions"] = lambda event: guard()
    return built
