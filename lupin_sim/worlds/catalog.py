"""The table of worlds, and the parser of world names."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from lupin_runtime.layout import LayoutError
from lupin_sim.world import World
from lupin_sim.worlds.demo import demo
from lupin_sim.worlds.layout import course, layout_file
from lupin_sim.worlds.random_world import random_world
from lupin_sim.worlds.walled import walled


class WorldError(ValueError):
    """A world cannot be built; the message says what was expected and found."""


@dataclass(frozen=True)
class Entry:
    """One kind of world. `make` takes the argument after the colon of the name ("" if there is none) and the seed."""

    name: str
    argument: str
    summary: str
    make: Callable[[str, int], World]


def _without_argument(make: Callable[[int], World]) -> Callable[[str, int], World]:
    def make_world(argument: str, seed: int) -> World:
        if argument:
            raise WorldError(f"this world takes no argument, found {argument!r}")
        return make(seed)

    return make_world


def _random(argument: str, seed: int) -> World:
    if argument and not (argument.isascii() and argument.isdigit()):
        raise WorldError(f"random:{argument}: the seed must be a whole number, as in random:7")
    return random_world(int(argument) if argument else seed)


CATALOG: tuple[Entry, ...] = (
    Entry(
        "demo",
        "",
        "the default: three rows of planters, wide aisles, a loop for the map to close",
        _without_argument(demo),
    ),
    Entry(
        "course",
        "STRETCH",
        "the packaged layout of mdp-greenhouse, stretched so that the robot fits (1.8)",
        course,
    ),
    Entry("random", "SEED", "another greenhouse for every seed; all tags can be reached", _random),
    Entry("walled", "", "a small greenhouse with a tag behind a fence: visible, not reachable", _without_argument(walled)),
)


def load_world(name: str, seed: int = 0) -> World:
    """Return the world of a name such as `demo`, `course:2`, `random:7`, or of a layout file's path. Raises WorldError."""
    kind, _, argument = name.partition(":")
    try:
        for entry in CATALOG:
            if entry.name == kind:
                return entry.make(argument, seed)
        if name.endswith(".json") or "/" in name:
            return layout_file(name, seed)
    except LayoutError as error:
        raise WorldError(str(error)) from None
    kinds = ", ".join(f"{e.name}:{e.argument}" if e.argument else e.name for e in CATALOG)
    raise WorldError(f"unknown world {name!r}; expected {kinds}, or the path of a layout file (*.json)")
