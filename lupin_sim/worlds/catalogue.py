"""The table of worlds, and how a name on a command line becomes one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from lupin_sim.world import World
from lupin_sim.worlds.demo import demo
from lupin_sim.worlds.layout import LayoutError, course, layout_file
from lupin_sim.worlds.random_world import random_world
from lupin_sim.worlds.walled import walled


class WorldError(ValueError):
    """A world that cannot be made; the message says what was expected and what was found."""


@dataclass(frozen=True)
class Entry:
    """One kind of world: `make` takes what stands behind the colon of its name ("" for nothing) and the seed."""

    name: str
    argument: str
    summary: str
    make: Callable[[str, int], World]


def _plain(make: Callable[[int], World]) -> Callable[[str, int], World]:
    def without_argument(argument: str, seed: int) -> World:
        if argument:
            raise WorldError(f"this world takes nothing after a colon, found {argument!r}")
        return make(seed)

    return without_argument


def _random(argument: str, seed: int) -> World:
    if argument and not (argument.isascii() and argument.isdigit()):
        raise WorldError(f"random:{argument}: the seed must be a whole number, as in random:7")
    return random_world(int(argument) if argument else seed)


CATALOGUE: tuple[Entry, ...] = (
    Entry("demo", "", "three rows of planters with wide aisles and a loop to close; the default", _plain(demo)),
    Entry("course", "STRETCH", "the packaged layout of mdp-greenhouse, spread so that the robot fits (1.8)", course),
    Entry("random", "SEED", "a fresh greenhouse for every seed, always solvable", _random),
    Entry("walled", "", "a small one with a tag behind a fence: seen, and not to be reached", _plain(walled)),
)


def load_world(name: str, seed: int = 0) -> World:
    """The world of a name such as `demo`, `course:2`, `random:7`, or of a layout file's path. Raises WorldError."""
    kind, _, argument = name.partition(":")
    try:
        for entry in CATALOGUE:
            if entry.name == kind:
                return entry.make(argument, seed)
        if name.endswith(".json") or "/" in name:
            return layout_file(name, seed)
    except LayoutError as error:
        raise WorldError(str(error)) from None
    kinds = ", ".join(f"{e.name}:{e.argument}" if e.argument else e.name for e in CATALOGUE)
    raise WorldError(f"no world {name!r}; there are {kinds}, or the path of a layout file (*.json)")
