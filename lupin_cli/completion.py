"""What a shell offers at Tab: names of runs, playbooks, worlds and processes. Those of robots: `connection.options`.

A shell waits for this at every Tab: nothing heavy is imported, and a file that cannot be read offers nothing.
"""

from __future__ import annotations

from collections.abc import Iterable

# A test compares them with the simulator's catalog, whose import takes too long here.
WORLDS = ("demo", "course", "random", "walled")


def matching(names: Iterable[str], incomplete: str) -> list[str]:
    """Return the names that begin with what is typed."""
    return [name for name in names if name.startswith(incomplete)]


def runs(incomplete: str) -> list[str]:
    """Return the ids of all runs and `latest`; for the end of an id, that end."""
    from lupin_runtime.stack.runs import all_runs

    return run_names([run.id for run in all_runs()], incomplete)


def live_runs(incomplete: str) -> list[str]:
    """Return the ids of the runs that are up."""
    from lupin_runtime.stack.runs import live_runs as find

    return run_names([run.id for run in find()], incomplete)


def playbooks(incomplete: str) -> list[str]:
    """Return the names of the shipped playbooks. A path of another one is completed by the shell."""
    from lupin_cli.package_data import shipped_folder

    return matching(sorted(path.stem for path in shipped_folder("playbooks").glob("*.yaml")), incomplete)


def worlds(incomplete: str) -> list[str]:
    """Return the worlds of the simulator. A layout file's path is completed by the shell."""
    return matching(WORLDS, incomplete)


def processes(incomplete: str) -> list[str]:
    """Return the processes of the stack on this machine."""
    from lupin_runtime.stack.options import LAPTOP_TARGETS
    from lupin_runtime.stack.table import TABLE

    names = (row.name for row in TABLE if not row.external and set(row.targets) & set(LAPTOP_TARGETS))
    return matching(names, incomplete)


def log_levels(incomplete: str) -> list[str]:
    """Return the levels of log lines."""
    from lupin_runtime.stack.log_lines import LEVELS

    return matching(LEVELS, incomplete)


def run_names(ids: list[str], incomplete: str) -> list[str]:
    """Return `latest` and the ids that begin with `incomplete`, newest first; if there are none, the ends of ids that do."""
    from lupin_runtime.stack.runs import LATEST

    if not ids:
        return []
    newest = sorted(ids, reverse=True)
    return matching([LATEST, *newest], incomplete) or matching((one.rpartition("-")[2] for one in newest), incomplete)
