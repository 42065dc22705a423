"""`lupin logs`: what the processes of a run have said."""

from __future__ import annotations

import time
from collections import deque
from pathlib import Path

import typer

FOLLOW_PERIOD_S = 0.2


def command(
    process: list[str] = typer.Argument(None, help="Processes; all without one."),
    run: str = typer.Option(None, "--run", help="A part of the run's name; without it the live or the newest run."),
    lines: int = typer.Option(40, "--lines", "-n", min=0, help="How many last lines of each."),
    follow: bool = typer.Option(False, "--follow", "-f", help="Go on until the run ends or you interrupt."),
) -> None:
    """What the processes of a run have said."""
    from lupin_runtime.stack.runs import RunError, find_run

    try:
        found = find_run(run)
    except RunError as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(3) from error
    files = sorted(found.logs.glob("*.log"))
    known = [path.stem for path in files]
    for name in process or []:
        if name not in known:
            typer.echo(f"run {found.id} has no process {name!r}; it has: {', '.join(known)}", err=True)
            raise typer.Exit(2)
    chosen = [path for path in files if not process or path.stem in process]
    for path in chosen:
        with path.open(errors="replace") as log:
            for line in deque(log, maxlen=lines):
                typer.echo(f"{path.stem:12s} {line.rstrip()}")
    if follow:
        _follow(chosen, found.alive)


def _follow(paths: list[Path], alive: object) -> None:
    streams = {path.stem: path.open(errors="replace") for path in paths}
    for stream in streams.values():
        stream.seek(0, 2)
    while callable(alive) and alive():
        for name, stream in streams.items():
            for line in stream:
                typer.echo(f"{name:12s} {line.rstrip()}")
        time.sleep(FOLLOW_PERIOD_S)
