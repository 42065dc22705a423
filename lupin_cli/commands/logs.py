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
    run: str = typer.Option(None, "--run", help="A part of the run's id; without it the live or the newest run."),
    lines: int = typer.Option(40, "--lines", "-n", min=0, help="Number of last lines of each log."),
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
    for path in selected:
        with path.open(errors="replace") as log:
            for line in deque(log, maxlen=lines):
                echo(f"{path.stem:12s} {line.rstrip()}")
    if follow:
        _follow(selected, found)


def _follow(paths: list[Path], run: Run) -> None:
    streams = {path.stem: path.open(errors="replace") for path in paths}
    for stream in streams.values():
        stream.seek(0, 2)
    while run.alive():
        for name, stream in streams.items():
            for line in stream:
                echo(f"{name:12s} {line.rstrip()}")
        time.sleep(FOLLOW_PERIOD_S)
