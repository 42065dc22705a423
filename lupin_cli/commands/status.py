"""`lupin status`: show the processes and the mission of a run."""

from __future__ import annotations

import json
import time
from typing import TYPE_CHECKING

import typer

from lupin_cli.exit_codes import FAILURE, SUCCESS, UNREACHABLE
from lupin_cli.terminal import echo

if TYPE_CHECKING:
    from lupin_runtime.stack.runs import Run


def command(
    run: str = typer.Option(None, "--run", help="Select the run by part of its id, if several are up."),
    watch: bool = typer.Option(False, "--watch", "-w", help="Update the view until the run ends or Ctrl-C."),
    as_json: bool = typer.Option(False, "--json", help="Print only JSON on standard output."),
) -> None:
    """Show the stages, processes and mission of a run. Changes nothing.

    Exit status: 0 every stage of the run is up and responds, 1 a stage is not up or there is an alarm, 3 no run is up.
    """
    from lupin_runtime.stack.alarms import alarms
    from lupin_runtime.stack.runs import RunError, find_live_run, live_runs

    try:
        found = find_live_run(run)
    except RunError as error:
        if as_json:
            print(json.dumps({"runs": [live.id for live in live_runs()], "error": str(error)}))
        else:
            echo(str(error), err=True)
        raise typer.Exit(UNREACHABLE) from error
    state = found.state()
    if as_json:
        print(json.dumps({**state, "alarms": alarms(state), "run": found.info()}))
    else:
        _show(found, watch)
        state = found.state()
    stages = state.get("stages", [])
    is_well = stages and all(stage["phase"] == "up" for stage in stages) and not alarms(state)
    raise typer.Exit(SUCCESS if is_well else FAILURE)


def _show(run: Run, watch: bool) -> None:
    from rich.console import Console
    from rich.live import Live

    from lupin_cli.run.live_view import run_view

    console = Console()
    if not watch:
        console.print(run_view(run.state()))
        return
    with Live(run_view(run.state()), console=console, auto_refresh=False) as live:
        while run.alive():
            live.update(run_view(run.state()), refresh=True)
            time.sleep(0.5)
