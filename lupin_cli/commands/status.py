"""`lupin status`: what runs."""

from __future__ import annotations

import json
import time

import typer


def command(
    run: str = typer.Option(None, "--run", help="A part of the run's name, where several are up."),
    watch: bool = typer.Option(False, "--watch", "-w", help="Keep showing until the run ends or you interrupt."),
    as_json: bool = typer.Option(False, "--json", help="Print JSON, alone on standard output."),
) -> None:
    """What runs: stages, processes, mission. Changes nothing.

    Exit status: 0 a run is up and all its stages are, 1 something of it is not up, 3 no run is up.
    """
    from lupin_runtime.stack.runs import RunError, find_live_run, live_runs

    try:
        found = find_live_run(run)
    except RunError as error:
        if as_json:
            print(json.dumps({"runs": [live.id for live in live_runs()], "error": str(error)}))
        else:
            typer.echo(str(error), err=True)
        raise typer.Exit(3) from error
    state = found.state()
    if as_json:
        print(json.dumps({**state, "run": found.info()}))
    else:
        _show(found, watch)
        state = found.state()
    stages = state.get("stages", [])
    raise typer.Exit(0 if stages and all(stage["phase"] == "up" for stage in stages) else 1)


def _show(found: object, watch: bool) -> None:
    from rich.console import Console
    from rich.live import Live

    from lupin_cli.live import run_view
    from lupin_runtime.stack.runs import Run

    assert isinstance(found, Run)
    console = Console()
    if not watch:
        console.print(run_view(found.state()))
        return
    with Live(run_view(found.state()), console=console, auto_refresh=False) as live:
        while found.alive():
            live.update(run_view(found.state()), refresh=True)
            time.sleep(0.5)
