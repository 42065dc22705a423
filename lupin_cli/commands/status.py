"""`lupin status`: show the processes and the mission of a run."""

from __future__ import annotations

import json
import time
from typing import TYPE_CHECKING

import typer

from lupin_cli.exit_codes import FAILURE, SUCCESS, UNREACHABLE
from lupin_cli.run.run_option import ANY_RUN
from lupin_cli.terminal import echo

if TYPE_CHECKING:
    from lupin_runtime.stack.runs import Run


def command(
    run: ANY_RUN = None,
    watch: bool = typer.Option(False, "--watch", "-w", help="Update the view until the run ends or Ctrl-C."),
    as_json: bool = typer.Option(False, "--json", help="Print only JSON on standard output."),
) -> None:
    """Show the processes and the mission of the run that is up; without one, how the last run ended. Changes nothing.

    Exit status: 0 every process of the run is up and responds, 1 a process is not up or there is an alarm, 3 no run is up.

    Example: lupin status --watch
    """
    from lupin_runtime.stack.alarms import alarms
    from lupin_runtime.stack.recorded import is_supervised
    from lupin_runtime.stack.runs import RunError, find_run, live_runs

    try:
        live = live_runs()
        if run is None and len(live) > 1:
            raise RunError(f"several runs are up; choose one with --run: {', '.join(one.id for one in live)}")
        found = find_run(run)
    except RunError as error:
        if as_json:
            print(json.dumps({"runs": [one.id for one in live], "error": str(error)}))
        else:
            echo(str(error), err=True)
        raise typer.Exit(UNREACHABLE) from error
    if not found.is_live() or not is_supervised(found):
        _show_ended(found, as_json)
        raise typer.Exit(UNREACHABLE)
    if not as_json:
        _show(found, watch)
        if not found.is_live():  # it ended while it was watched
            _show_ended(found, as_json)
            raise typer.Exit(UNREACHABLE)
    state = found.state()
    if as_json:
        print(json.dumps({**state, "alarms": alarms(state), "run": found.info()}))
    stages = state.get("stages", [])
    is_well = stages and all(stage["phase"] == "up" for stage in stages) and not alarms(state)
    raise typer.Exit(SUCCESS if is_well else FAILURE)


def _show(run: Run, watch: bool) -> None:
    from lupin_cli.run.live_view import Repainter, run_view
    from lupin_cli.safe_console import SafeConsole
    from lupin_runtime.stack.recorded import is_supervised

    console = SafeConsole()
    if not watch:
        console.print(run_view(run.state(), console, every_process=True))
        return
    # Transient: what was shown last is no longer true when the run has ended, and gives way to its result.
    with Repainter(console, transient=True) as repainter:
        while run.is_live() and is_supervised(run):
            repainter.paint(run_view(run.state(), console))
            time.sleep(0.5)


def _show_ended(run: Run, as_json: bool) -> None:
    """Print how a run ended. Its last state is not shown: nobody keeps it true any more."""
    from lupin_runtime.stack.results import result_of
    from lupin_runtime.stack.runs import live_runs

    result = result_of(run)
    up = [live.id for live in live_runs() if live.id != run.id]
    if as_json:
        print(json.dumps({"runs": up, "error": f"run {run.id} is not up", "last_result": result.as_json()}))
        return
    from lupin_cli.run.results import result_lines

    for line in result_lines(result):
        echo(line)
    other = f"these runs are up: {', '.join(up)}" if up else "no run is up; start one with: lupin up"
    echo(f"{other}\nearlier runs: lupin runs", err=True)
