"""The checks that can run: Lupin's own, those of plug-ins, and the selection by `--only` and `--skip`.

A module that `findings.FINDINGS` names exports `CHECKS`, a tuple. Other packages add checks by an entry point of the group
`lupin.checks` that names a Check or a sequence of them. A plug-in that cannot be loaded is listed in the diagnosis and
affects nothing else.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterable
from contextlib import suppress
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING

from lupin_cli.checks.base import Check, Gap
from lupin_cli.checks.findings import modules

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

ENTRY_POINT_GROUP = "lupin.checks"


class UnknownCheck(ValueError):
    """A pattern of --only or --skip matches no check."""


def built_in() -> tuple[Check, ...]:
    """Return Lupin's own checks, in the order of the table of findings."""
    return tuple(check for module in modules() for check in importlib.import_module(module).CHECKS)


def plugged_in(entry_points: Iterable[EntryPoint] | None = None) -> tuple[tuple[Check, ...], tuple[Gap, ...]]:
    """Load the checks of other packages. Return them, and the plug-ins that could not be loaded."""
    if entry_points is None:
        entry_points = _installed_entry_points()
    checks: list[Check] = []
    errors: list[Gap] = []
    for entry in entry_points:
        plugin = f"{entry.name} ({entry.value})"
        try:
            loaded = entry.load()
            found = (loaded,) if isinstance(loaded, Check) else tuple(loaded)
        except Exception as error:  # foreign code may raise anything, and must not abort the diagnosis
            errors.append(Gap("plug-in", plugin, f"{type(error).__name__}: {error}"))
            continue
        if others := [each for each in found if not isinstance(each, Check)]:
            errors.append(Gap("plug-in", plugin, f"{others[0]!r} is not a lupin_cli.checks.Check"))
            continue
        checks += found
    return tuple(checks), tuple(errors)


def _installed_entry_points() -> Iterable[EntryPoint]:
    """Return the installed entry points of the group.

    `importlib.metadata`, which parses the entry points of every group, takes 19 ms; this search takes 2 ms. The former is used
    only if the file of an installed distribution contains this group.
    """
    group = f"[{ENTRY_POINT_GROUP}]".encode()
    for folder in map(Path, sys.path):  # noqa: TID251 -- read, not edited
        for file in folder.glob("*.*-info/entry_points.txt"):
            with suppress(OSError):
                if group in file.read_bytes():
                    from importlib.metadata import entry_points

                    return entry_points(group=ENTRY_POINT_GROUP)
    return ()


def select(checks: Iterable[Check], only: Iterable[str] = (), skip: Iterable[str] = ()) -> tuple[Check, ...]:
    """Select the checks whose name matches a pattern of `only` (all if it is empty) and none of `skip`. Raises UnknownCheck."""
    checks, only, skip = tuple(checks), tuple(only), tuple(skip)
    names = [check.name for check in checks]
    for pattern in (*only, *skip):
        if not any(fnmatchcase(name, pattern) for name in names):
            raise UnknownCheck(_unknown_message(pattern, names))
    return tuple(
        check
        for check in checks
        if (not only or any(fnmatchcase(check.name, pattern) for pattern in only))
        and not any(fnmatchcase(check.name, pattern) for pattern in skip)
    )


def _unknown_message(pattern: str, names: list[str]) -> str:
    from difflib import get_close_matches

    near = get_close_matches(pattern, names, n=1)
    hint = f"did you mean {near[0]}?" if near else "list the checks with: lupin doctor --list"
    return f"no check is called {pattern!r}; {hint}"
