"""The mission diagram as boxes and arrows, derived from the state machine's specification; all formats are drawn from it."""

from __future__ import annotations

from dataclasses import dataclass

from lupin_runtime.mission.hsm_spec import SEPARATOR, HsmSpec, StateSpec


@dataclass(frozen=True)
class Arrow:
    """An arrow between two states, labeled with every trigger that takes it."""

    source: str
    dest: str
    labels: tuple[str, ...]

    @property
    def text(self) -> str:
        """The labels on one line."""
        return " / ".join(self.labels)

    @property
    def is_fault(self) -> bool:
        """Whether only `fault` takes this arrow: almost every state has one."""
        return self.labels == ("fault",)

    def is_within(self, composite: str) -> bool:
        """Return whether both ends are leaves of a composite state."""
        prefix = composite + SEPARATOR
        return self.source.startswith(prefix) and self.dest.startswith(prefix)


@dataclass(frozen=True)
class Diagram:
    """The states in their order, with the initial one, and one arrow for each connected pair."""

    initial: str
    states: tuple[StateSpec, ...]
    arrows: tuple[Arrow, ...]


def build_diagram(spec: HsmSpec) -> Diagram:
    """Merge the transitions between two states into one arrow; transitions from every leaf leave their composite state."""
    labels: dict[tuple[str, str], list[str]] = {}
    for transition in spec.transitions:
        label = f"{transition.trigger} [{transition.guard}]" if transition.guard else transition.trigger
        for source in _merge_leaves(spec, transition.sources):
            found = labels.setdefault((source, transition.dest), [])
            if label not in found:
                found.append(label)
    arrows = tuple(Arrow(source, dest, tuple(found)) for (source, dest), found in labels.items())
    return Diagram(spec.initial, spec.states, arrows)


def _merge_leaves(spec: HsmSpec, sources: tuple[str, ...]) -> list[str]:
    """Replace all leaves of a composite state by the state itself, at the first one's position."""
    result = list(sources)
    for state in spec.states:
        leaves = [SEPARATOR.join((state.name, child)) for child in state.children]
        if leaves and (state.name in result or all(leaf in result for leaf in leaves)):
            first = min(result.index(name) for name in (state.name, *leaves) if name in result)
            result.insert(first, state.name)
            result = [name for i, name in enumerate(result) if name not in leaves and (name != state.name or i == first)]
    return result
