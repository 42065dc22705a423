"""The table of worlds, and how a name on a command line becomes one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from lupin_sim.world import World
from lupin_sim.worlds.demo import demo


class WorldError(ValueError):
    """A world that cannot be made; the message says what was expected and what was found."""


@dataclass(frozen=True)
class Entry:
    """One kind of world: `make` takes what stands behind the colon of its name ("" for nothing) and the seed."""

    name: str
    summary: str
    make: Callable[[str, int], World]


CATALOGUE: tuple[Entry, ...] = (
    Entry("demo", "three rows of planters, 12 tags, wide aisles, a loop to close", lambda _, seed: demo(seed)),
)


def load_world(name: str, seed: int = 0) -> World:
    """The world of a name such as `demo`. Raises WorldError."""
    kind, _, argument = name.partition(":")
    for entry in CATALOGUE:
        if entry.name == kind:
            return entry.make(argument, seed)
    raise WorldError(f"no world {name!r}; there are {', '.join(entry.name for entry in CATALOGUE)}")
