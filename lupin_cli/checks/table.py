"""The table of checks, in the order in which a person would ask: the way there, the phone book, the processes, the rest.

A module of this list exports `CHECKS`, a tuple. Others add theirs by an entry point of the group `lupin.checks` that names a
Check or a sequence of them; one that can't be loaded is named in the diagnosis and stops nothing else.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterable
from contextlib import suppress
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from lupin_cli.checks.base import Check

ENTRY_POINT_GROUP = "lupin.checks"

MODULES: tuple[str, ...] = (
    "lupin_cli.checks.link",
    "lupin_cli.checks.discovery",
    "lupin_cli.checks.homing",
    "lupin_cli.checks.environment",
    "lupin_cli.checks.profiles",
    "lupin_cli.checks.leftovers",
    "lupin_cli.checks.ports",
    "lupin_cli.checks.software",
    "lupin_cli.checks.services",
    "lupin_cli.checks.clocks",
    "lupin_cli.checks.samples",
    "lupin_cli.checks.controllers",
    "lupin_cli.checks.drive",
    "lupin_cli.checks.board",
    "lupin_cli.checks.cameras",
    "lupin_cli.checks.resources",
)


class UnknownCheck(ValueError):
    """A pattern of --only or --skip that no check answers to."""


def built_in() -> tuple[Check, ...]:
    """Lupin's own checks, in the table's order."""
    return tuple(check for module in MODULES for check in importlib.import_module(module).CHECKS)


def plugged_in(entry_points: Iterable[Any] | None = None) -> tuple[tuple[Check, ...], tuple[str, ...]]:
    """Checks of other packages, and one line for each plug-in that could not be loaded."""
    if entry_points is None:
        entry_points = _installed()
    checks: list[Check] = []
    broken: list[str] = []
    for entry in entry_points:
        try:
            loaded = entry.load()
            found = (loaded,) if isinstance(loaded, Check) else tuple(loaded)
        except Exception as error:  # somebody else's code: whatever it raises, it must not cost the diagnosis
            broken.append(f"plug-in {entry.name} ({entry.value}): {type(error).__name__}: {error}")
            continue
        if strays := [each for each in found if not isinstance(each, Check)]:
            broken.append(f"plug-in {entry.name} ({entry.value}): {strays[0]!r} is not a lupin_cli.checks.Check")
            continue
        checks += found
    return tuple(checks), tuple(broken)


def _installed() -> Iterable[Any]:
    """The installed entry points of the group. `importlib.metadata` reads those of every group, which takes it longer than all
    checks: it is asked only where a distribution's file names ours."""
    group = f"[{ENTRY_POINT_GROUP}]".encode()
    for folder in map(Path, sys.path):
        for told in folder.glob("*.*-info/entry_points.txt"):
            with suppress(OSError):
                if group in told.read_bytes():
                    from importlib.metadata import entry_points

                    return entry_points(group=ENTRY_POINT_GROUP)
    return ()


def select(checks: Iterable[Check], only: Iterable[str] = (), skip: Iterable[str] = ()) -> tuple[Check, ...]:
    """The checks whose name matches a pattern of `only` (all, where there is none) and none of `skip`. Raises UnknownCheck."""
    checks, only, skip = tuple(checks), tuple(only), tuple(skip)
    names = [check.name for check in checks]
    for pattern in (*only, *skip):
        if not any(fnmatchcase(name, pattern) for name in names):
            raise UnknownCheck(_no_such(pattern, names))
    return tuple(
        check
        for check in checks
        if (not only or any(fnmatchcase(check.name, pattern) for pattern in only))
        and not any(fnmatchcase(check.name, pattern) for pattern in skip)
    )


def _no_such(pattern: str, names: list[str]) -> str:
    from difflib import get_close_matches

    near = get_close_matches(pattern, names, n=1)
    return f"no check is called {pattern!r}; " + (f"did you mean {near[0]}?" if near else "list them with: lupin doctor --list")
