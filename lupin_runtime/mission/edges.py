"""The arrows of a state machine as a reader wants them: one for each pair of states, composites taken as a whole."""

from __future__ import annotations

from dataclasses import dataclass

from lupin_runtime.mission.hsm import SEPARATOR, HsmSpec


@dataclass(frozen=True)
class Edge:
    """An arrow between states, with all triggers that take it."""

    source: str
    dest: str
    labels: tuple[str, ...]

    @property
    def text(self) -> str:
        """The triggers on one line."""
        return " / ".join(self.labels)


def edges(spec: HsmSpec) -> list[Edge]:
    """The arrows of a machine; those that leave from every leaf of a composite leave from the composite."""
    labels: dict[tuple[str, str], list[str]] = {}
    for transition in spec.transitions:
        label = f"{transition.trigger} [{transition.guard}]" if transition.guard else transition.trigger
        for source in _collapsed(spec, transition.sources):
            found = labels.setdefault((source, transition.dest), [])
            if label not in found:
                found.append(label)
    return [Edge(source, dest, tuple(found)) for (source, dest), found in labels.items()]


def _collapsed(spec: HsmSpec, sources: tuple[str, ...]) -> list[str]:
    result = list(sources)
    for state in spec.states:
        leaves = [SEPARATOR.join((state.name, child)) for child in state.children]
        if leaves and (state.name in result or all(leaf in result for leaf in leaves)):
            first = min(result.index(name) for name in (state.name, *leaves) if name in result)
            result.insert(first, state.name)
            result = [name for i, name in enumerate(result) if name not in leaves and (name != state.name or i == first)]
    return result
