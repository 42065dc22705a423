"""Runs the mission's hierarchical state machine with the `transitions` package."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from lupin_runtime.mission.hsm_spec import SEPARATOR, HsmSpec, StateSpec, TransitionSpec, Trigger, build_hsm_spec

if TYPE_CHECKING:
    from transitions import EventData

_MAX_IGNORED = 100  # triggers kept for debugging


class MissionHsm:
    """The running state machine. Triggers that are fired during a transition are queued.

    A trigger that the current state does not declare never raises: it is recorded in `ignored` as (state, trigger).

    `guards` maps each guard name of the specification to a function. `on_change(source, dest)` is called after every
    transition, before queued triggers are processed, with full state names such as `INSPECTING.SCANNING`.
    """

    def __init__(
        self,
        guards: dict[str, Callable[[], bool]],
        on_change: Callable[[str, str], None] = lambda _source, _dest: None,
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
        self._previous_state = self.spec.initial
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

    def _changed(self, _event: EventData) -> None:
        source, self._previous_state = self._previous_state, self.state
        self._on_change(source, self.state)

    @property
    def state(self) -> str:
        """The full name of the current state, such as `INSPECTING.SCANNING`."""
        return self._model.state

    @property
    def top_level_state(self) -> str:
        """The outermost state, such as `INSPECTING`."""
        return self.state.split(SEPARATOR)[0]

    @property
    def substate(self) -> str:
        """The state's name within its composite state, such as `SCANNING`; "" outside composite states."""
        return self.state.split(SEPARATOR)[1] if SEPARATOR in self.state else ""

    def fire(self, trigger: Trigger) -> bool:
        """Fire a trigger, or queue it during a transition; return whether the current state declares it.

        A trigger that is not declared is recorded in `ignored`. A declared one that all guards reject changes nothing.
        """
        if not self.spec.destinations(trigger, self.state):
            self.ignored.append((self.state, trigger))
            del self.ignored[:-_MAX_IGNORED]
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
        built["conditions"] = lambda _event: guard()
    return built
