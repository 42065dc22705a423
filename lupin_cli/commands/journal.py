"""`lupin journal`: the record of playbook runs."""

from __future__ import annotations

import dataclasses
import json
from typing import TYPE_CHECKING, Any

import typer

from lupin_cli.exit_codes import USAGE_ERROR
from lupin_cli.terminal import echo

if TYPE_CHECKING:
    from lupin_cli.playbook.run_record import RunRecord

app = typer.Typer(
    help="Show the record of playbook runs: steps, changes and outputs.",
    add_completion=False,
    rich_markup_mode=None,
    invoke_without_command=True,
)
AS_JSON = typer.Option(False, "--json", help="Print only JSON on standard output.")


@app.callback()
def journal(context: typer.Context, as_json: bool = AS_JSON) -> None:
    """Show the record of playbook runs: steps, changes and outputs."""
    if context.invoked_subcommand is None:
        _list(as_json, 20)


@app.command("list")
def list_(as_json: bool = AS_JSON, count: int = typer.Option(20, "-n", help="List this many runs.", min=1)) -> None:
    """List the runs, the newest first.

    Exit status: 0 listed.
    """
    _list(as_json, count)


@app.command()
def show(
    run: str = typer.Argument("latest", help="A run's id, the start of one, or: latest."),
    as_json: bool = AS_JSON,
) -> None:
    """Show one run: its variables, and each step with its changes and outputs.

    Exit status: 0 shown, 2 there is no such run.
    """
    from lupin_cli.playbook import JournalError, find_playbook_run

    try:
        record = find_playbook_run(run)
    except JournalError as error:
        echo(f"lupin journal: {error}", err=True)
        if error.next_command:
            echo(f"  next: {error.next_command}", err=True)
        raise typer.Exit(USAGE_ERROR) from error
    if as_json:
        print(json.dumps(_plain(record, steps=True)))
    else:
        _print_run(record)


def _list(as_json: bool, count: int) -> None:
    from lupin_cli.playbook import list_runs

    runs = list_runs()[:count]
    if as_json:
        print(json.dumps([_plain(run, steps=False) for run in runs]))
        return
    if not runs:
        echo("no playbook has been run yet; list the playbooks with: lupin play --list")
    for run in runs:
        changed = sum(step.state == "changed" for step in run.steps)
        echo(f"{run.run:<48} {run.state:<12} {changed} of {len(run.steps)} steps changed")


def _plain(run: RunRecord, *, steps: bool) -> dict[str, Any]:
    # `before` is left out: it is for undo, and may contain secrets.
    record = dataclasses.asdict(run)
    record["path"] = str(run.path)
    record["steps"] = (
        [{k: v for k, v in step.items() if k != "before"} for step in record["steps"]] if steps else len(run.steps)
    )
    return record


def _print_run(run: RunRecord) -> None:
    echo(f"{run.run}: {run.state}; started {run.started}" + (f", undoes {run.undo_of}" if run.undo_of else ""))
    for name, value in run.variables.items():
        echo(f"  {name} = {value}")
    for step in run.steps:
        echo(f"{step.index + 1:3} {step.state:<12} {step.name} [{step.operation} on {step.machine}] {step.duration_s:.1f} s")
        for text in (step.summary, step.error):
            if text:
                echo(f"      {text}")
        for line in step.diff.splitlines():
            echo(f"      {line}")
        for output in step.outputs:
            for line in output.splitlines():
                echo(f"      | {line}")
    if not run.finished and not run.undo_of:
        robot = f" --robot {run.robot}" if run.robot else ""
        echo(f"next: lupin play {run.playbook}{robot} --resume, or: lupin play {run.playbook}{robot} --undo {run.run}")
