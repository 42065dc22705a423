"""`lupin logs`: print the logs of a run's processes."""

from __future__ import annotations

import time
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from lupin_cli.exit_codes import UNREACHABLE, USAGE_ERROR
from lupin_cli.terminal import echo

if TYPE_CHECKING:
    from lupin_runtime.stack.runs import Run

FOLLOW_PERIOD_S = 0.2


def command(
    process: list[str] = typer.Argument(None, help="Names of processes; without one, all."),
    run: str = typer.Option(None, "--run", help="Select the run by part of its id; without it, the live or the newest run."),
    lines: int = typer.Option(40, "--lines", "-n", min=0, help="Print this many of the last lines of each log."),
    follow: bool = typer.Option(False, "--follow", "-f", help="Print new lines until the run ends or Ctrl-C."),
) -> None:
    """Print the logs of a run's processes.

    Exit status: 0 printed, 2 the run has no such process, 3 no such run.
    """
    from lupin_runtime.stack.runs import RunError, find_run

    try:
        found = find_run(run)
    except RunError as error:
        echo(str(error), err=True)
        raise typer.Exit(UNREACHABLE) from error
    files = sorted(found.logs.glob("*.log"))
    known = [path.stem for path in files]
    for name in process or []:
        if name not in known:
            echo(f"run {found.id} has no process {name!r}; it has: {', '.join(known)}", err=True)
            raise typer.Exit(USAGE_ERROR)
    selected = [path for path in files if not process or path.stem in process]
    tails = {path: _Tail(path) for path in selected}
    for path, tail in tails.items():
        for line in deque(tail.lines(), maxlen=lines):
            echo(f"{path.stem:12s} {line}")
        if tail.rest and lines and not follow:
            echo(f"{path.stem:12s} {tail.rest}")
    if follow:
        _follow(found, process or [], tails)


class _Tail:
    """The lines of a log, read as it grows. A log that was truncated is read from its beginning."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._position = 0
        self._rest = b""

    @property
    def rest(self) -> str:
        """The last line, which its process has not completed yet."""
        return self._rest.decode(errors="replace").rstrip()

    def lines(self) -> list[str]:
        """Return the lines that were completed since the last call; the first call returns all of them."""
        try:
            with self._path.open("rb") as log:
                if log.seek(0, 2) < self._position:
                    self._position, self._rest = 0, b""
                log.seek(self._position)
                data = log.read()
        except OSError:
            return []  # being replaced, or the disk fails: the next call tries again
        self._position += len(data)
        *complete, self._rest = (self._rest + data).split(b"\n")
        return [line.decode(errors="replace").rstrip() for line in complete]


def _follow(run: Run, processes: list[str], tails: dict[Path, _Tail]) -> None:
    """Print new lines until the run has ended, also those of processes that start later, unless some were named."""
    alive = True
    while alive:
        alive = run.alive()  # read first, so that what a process writes at its end is printed too
        for path in sorted(run.logs.glob("*.log")):
            if processes and path.stem not in processes:
                continue
            for line in tails.setdefault(path, _Tail(path)).lines():
                echo(f"{path.stem:12s} {line}")
        if alive:
            time.sleep(FOLLOW_PERIOD_S)
