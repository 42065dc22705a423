"""`lupin down`: end a run."""

from __future__ import annotations

import os
import signal
import time

import typer

STOP_BOUND_S = 30.0


def command(
    run: str = typer.Option(None, "--run", help="A part of the run's name, where several are up."),
    everything: bool = typer.Option(False, "--all", help="End every run of this user."),
    dry_run: bool = typer.Option(False, "--dry-run", help="Say what would be ended."),
) -> None:
    """Stop a run and leave nothing behind.

    Exit status: 0 ended (or nothing was up with --all), 1 it did not end within 30 s, 3 no such run.
    """
    from lupin_runtime.stack.runs import RunError, find_live_run, live_runs

    try:
        found = live_runs() if everything else [find_live_run(run)]
    except RunError as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(3) from error
    for one in found:
        pid = one.info().get("pid")
        if dry_run or not isinstance(pid, int):
            typer.echo(f"would end run {one.id} (supervisor {pid})")
            continue
        os.kill(pid, signal.SIGTERM)
        deadline = time.monotonic() + STOP_BOUND_S
        while one.alive():
            if time.monotonic() > deadline:
                typer.echo(f"run {one.id} did not end within {STOP_BOUND_S:.0f} s; its supervisor is {pid}", err=True)
                raise typer.Exit(1)
            time.sleep(0.05)
        typer.echo(f"run {one.id} ended")
