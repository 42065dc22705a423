"""`lupin journal`: the record of playbook runs."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import typer

from lupin_cli.command_group import command_group
from lupin_cli.completion import run_names
from lupin_cli.exit_codes import USAGE_ERROR
from lupin_cli.printed_commands import print_next
from lupin_cli.terminal import echo

if TYPE_CHECKING:
    from lupin_cli.playbook.run_record import RunRecord

app = command_group(
    "Show the record of playbook runs: steps, changes and outputs.", "lupin journal", invoke_without_command=True
)
AS_JSON = typer.Option(False, "--json", help="Print only JSON on standard output.")


def playbook_runs(incomplete: str) -> list[str]:
    """Return the ids of playbook runs that a shell offers at Tab."""
    from lupin_cli.playbook.journal import journal_folder

    return run_names([path.stem for path in journal_folder().glob("*.jsonl")], incomplete)


@app.callback()
def journal(context: typer.Context, as_json: bool = AS_JSON) -> None:
    """Show the record of playbook runs: steps, changes and outputs."""
    if context.invoked_subcommand is None:
        _list(as_json, 20)


@app.command("list")
def list_(as_json: bool = AS_JSON, count: int = typer.Option(20, "-n", help="List this many runs.", min=1)) -> None:
    """List the runs, the newest first.

    Exit status: 0 listed.

    Example: lupin journal list -n 5
    """
    _list(as_json, count)


@app.command()
def show(
    run: str = typer.Argument("latest", help="Any unique part of a run's id, or: latest.", autocompletion=playbook_runs),
    as_json: bool = AS_JSON,
) -> None:
    """Show one run: its variables, and each step with its changes and outputs.

    Exit status: 0 shown, 2 there is no such run.

    Example: lupin journal show latest
    """
    from lupin_cli.playbook import JournalError, find_playbook_run, list_runs

    try:
        record = find_playbook_run(run)
    except JournalError as error:
        echo(f"lupin journal: {error}", err=True)
        print_next(error.next_command)
        raise typer.Exit(USAGE_ERROR) from error
    can_resume = _resumable([record], list_runs())
    if as_json:
        print(json.dumps(_plain(record, steps=True, can_resume=record.run in can_resume)))
    else:
        _print_run(record, can_resume=record.run in can_resume)


def _resumable(chosen: Iterable[RunRecord], runs: Iterable[RunRecord]) -> set[str]:
    """Return the ids of those chosen runs that can be resumed, given all `runs`."""
    from lupin_cli.playbook.run_record import undone_runs

    undone = undone_runs(runs)
    return {run.run for run in chosen if not (run.finished or run.undo_of or run.closed or run.run in undone)}


def _list(as_json: bool, count: int) -> None:
    from lupin_cli.playbook import list_runs

    every_run = list_runs()
    runs = every_run[:count]
    if as_json:
        can_resume = _resumable(runs, every_run)
        print(json.dumps([_plain(run, steps=False, can_resume=run.run in can_resume) for run in runs]))
        return
    if not runs:
        echo("no playbook has been run yet; list the playbooks with: lupin play --list")
    for run in runs:
        changed = sum(step.state == "changed" for step in run.steps)
        echo(
            f"{run.run:<48} {run.state:<11} {run.operator or '-':<20} {run.duration_s:>6.0f} s  "
            f"{changed} of {len(run.steps)} steps changed"
        )


def _plain(run: RunRecord, *, steps: bool, can_resume: bool) -> dict[str, Any]:
    from lupin_cli.playbook.run_record import resume_command

    # What is for undo only is left out; `before` may contain secrets.
    record = dataclasses.asdict(run)
    record["path"] = str(run.path)
    record["resume"] = resume_command(run) if can_resume else ""
    record["steps"] = (
        [{k: v for k, v in step.items() if k not in ("before", "found", "left")} for step in record["steps"]]
        if steps
        else len(run.steps)
    )
    return record


def _print_run(run: RunRecord, *, can_resume: bool) -> None:
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
        from lupin_cli.playbook.run_record import resume_command, undo_command

        print_next(resume_command(run) if can_resume else run.command)
        print_next(undo_command(run), "or")
