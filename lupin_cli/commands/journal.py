"""`lupin journal`: what playbooks did, when and where."""

from __future__ import annotations

import dataclasses
import json
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from lupin_cli.runbook.journal import RunRecord

app = typer.Typer(
    help="What playbooks did: every run with its steps and outputs.",
    add_completion=False,
    rich_markup_mode=None,
    invoke_without_command=True,
)
AS_JSON = typer.Option(False, "--json", help="Print JSON, alone on standard output.")


@app.callback()
def journal(context: typer.Context, as_json: bool = AS_JSON) -> None:
    """What playbooks did: every run with its steps and outputs."""
    if context.invoked_subcommand is None:
        _list(as_json, 20)


@app.command("list")
def list_(as_json: bool = AS_JSON, count: int = typer.Option(20, "-n", help="How many, the newest first.", min=1)) -> None:
    """The runs, the newest first.

    Exit status: 0.
    """
    _list(as_json, count)


@app.command()
def show(
    run: str = typer.Argument("latest", help="A run's id, its beginning, or: latest."),
    as_json: bool = AS_JSON,
) -> None:
    """One run: its variables, and each step with what it changed and what was said.

    Exit status: 0 shown, 2 there is no such run.
    """
    from lupin_cli.runbook import JournalError, find_run

    try:
        record = find_run(run)
    except JournalError as error:
        typer.echo(f"lupin journal: {error}", err=True)
        if error.next_command:
            typer.echo(f"  next: {error.next_command}", err=True)
        raise typer.Exit(2) from error
    if as_json:
        print(json.dumps(_plain(record, steps=True)))
    else:
        _tell(record)


def _list(as_json: bool, count: int) -> None:
    from lupin_cli.runbook import list_runs

    runs = list_runs()[:count]
    if as_json:
        print(json.dumps([_plain(run, steps=False) for run in runs]))
        return
    if not runs:
        typer.echo("no playbook was played yet; they are listed by: lupin play --list")
    for run in runs:
        changed = sum(step.state == "changed" for step in run.steps)
        typer.echo(f"{run.run:<48} {run.state:<12} {changed} of {len(run.steps)} steps changed")


def _plain(run: RunRecord, *, steps: bool) -> dict[str, Any]:
    # What stood there before is undo's, and may hold what nobody wants on a screen.
    found = dataclasses.asdict(run)
    found["path"] = str(run.path)
    found["steps"] = [{k: v for k, v in step.items() if k != "before"} for step in found["steps"]] if steps else len(run.steps)
    return found


def _tell(run: RunRecord) -> None:
    typer.echo(f"{run.run}: {run.state}; begun {run.started}" + (f", takes back {run.undo_of}" if run.undo_of else ""))
    for name, value in run.variables.items():
        typer.echo(f"  {name} = {value}")
    for step in run.steps:
        typer.echo(
            f"{step.index + 1:3} {step.state:<12} {step.name} [{step.operation} on {step.machine}] {step.duration_s:.1f} s"
        )
        for text in (step.summary, step.error):
            if text:
                typer.echo(f"      {text}")
        for line in step.diff.splitlines():
            typer.echo(f"      {line}")
        for output in step.outputs:
            for line in output.splitlines():
                typer.echo(f"      | {line}")
    if not run.finished and not run.undo_of:
        robot = f" --robot {run.robot}" if run.robot else ""
        typer.echo(f"next: lupin play {run.playbook}{robot} --resume, or: lupin play {run.playbook}{robot} --undo {run.run}")
