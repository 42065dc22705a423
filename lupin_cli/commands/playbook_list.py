"""`lupin play --list`: the shipped playbooks, or the steps of one."""

from __future__ import annotations

import json
from typing import NoReturn

import typer

from lupin_cli.exit_codes import USAGE_ERROR
from lupin_cli.printed_commands import print_next
from lupin_cli.terminal import echo


def fail_usage(message: str, next_command: str = "") -> NoReturn:
    """Print a usage error of `lupin play`, and exit."""
    echo(f"lupin play: {message}", err=True)
    print_next(next_command)
    raise typer.Exit(USAGE_ERROR)


def list_playbooks(name: str | None, as_json: bool) -> None:
    """Print the shipped playbooks; with a name, that playbook's steps."""
    if name:
        _list_steps(name, as_json)
    else:
        _list_shipped(as_json)


def _list_shipped(as_json: bool) -> None:
    from lupin_cli.playbook import PlaybookError, list_shipped, load

    try:
        playbooks = [load(path) for path in list_shipped()]
    except PlaybookError as error:
        fail_usage(str(error))
    if as_json:
        print(json.dumps([{"name": b.name, "description": b.description, "machines": sorted(b.machines)} for b in playbooks]))
        return
    width = max((len(book.name) for book in playbooks), default=0)
    for book in playbooks:
        echo(f"{book.name:{width}}  {book.description}")


def _list_steps(name: str, as_json: bool) -> None:
    """Print the steps of a playbook, as --from and --tag name them."""
    from lupin_cli.playbook import PlaybookError, load

    try:
        playbook = load(name)
    except (FileNotFoundError, PlaybookError) as error:
        fail_usage(str(error), "lupin play --list")
    if as_json:
        rows = [
            {
                "number": number,
                "name": step.name,
                "operation": step.operation.name,
                "machine": step.machine,
                "tags": sorted(step.tags),
                "asks": step.confirm is not None,
                "read_only": step.operation.read_only,
            }
            for number, step in enumerate(playbook.steps, 1)
        ]
        print(json.dumps({"name": playbook.name, "description": playbook.description, "steps": rows}))
        return
    echo(f"{playbook.name}: {playbook.description}")
    for number, step in enumerate(playbook.steps, 1):
        notes = sorted(step.tags)
        notes += ["asks first"] if step.confirm is not None else []
        notes += ["reads only"] if step.operation.read_only else []
        after = f"  {', '.join(notes)}" if notes else ""
        echo(f"{number:3} {step.name}  [{step.operation.name} on {step.machine}]{after}")
