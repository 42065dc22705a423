"""`lupin run PROCESS`: run one process of the stack in the foreground, on the graph of the live run."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING

import typer

from lupin_cli.exit_codes import UNREACHABLE, USAGE_ERROR
from lupin_cli.terminal import echo

if TYPE_CHECKING:
    from lupin_runtime.stack.table import ProcessRow


def command(
    process: str = typer.Argument(None, help="A process of the stack; without one, list the processes."),
    run: str = typer.Option(None, "--run", help="Select the run by part of its id, if several are up."),
    parameter: list[str] = typer.Option([], "--parameter", "-p", help="Override a parameter: NODE.NAME=VALUE, VALUE as JSON."),
) -> None:
    """Run one process of the stack in the foreground, on the graph of the live run if there is one."""
    from lupin_cli.run.foreground import graph_of, run_in_foreground
    from lupin_runtime.stack.options import Options
    from lupin_runtime.stack.runs import RunError
    from lupin_runtime.stack.table import TABLE, launch

    rows = {row.name: row for row in TABLE if not row.external}
    if process is None:
        for row in rows.values():
            echo(f"{row.name:13s} {', '.join(node.path.split(':')[1] for node in row.nodes) or _program(row)}")
        return
    if process not in rows:
        echo(f"there is no process {process!r}; the processes are: {', '.join(rows)}", err=True)
        raise typer.Exit(USAGE_ERROR)
    try:
        environment, folder = graph_of(run)
    except RunError as error:
        echo(str(error), err=True)
        raise typer.Exit(UNREACHABLE) from error
    made = launch(rows[process], Options(run_path=folder, mission=True))
    if made.config is not None:
        _override(made.config, parameter)
    raise typer.Exit(run_in_foreground(made, environment, folder))


def _program(row: ProcessRow) -> str:
    """Return the program of a row without nodes."""
    from lupin_runtime.stack.options import Options

    command = row.command(Options()) if row.command is not None else [sys.executable]
    return command[2] if command[1] == "lupin_runtime.stack.external" else command[1]


def _override(config: dict[str, object], settings: list[str]) -> None:
    nodes = config["nodes"]
    assert isinstance(nodes, list)
    by_name = {str(node["class"]).split(":")[1]: node for node in nodes}
    for setting in settings:
        target, separator, text = setting.partition("=")
        node, dot, name = target.partition(".")
        if not separator or not dot or node not in by_name:
            raise typer.BadParameter(f"{setting!r} is not NODE.NAME=VALUE with NODE of: {', '.join(by_name)}")
        try:
            by_name[node]["parameters"][name] = json.loads(text)
        except ValueError:
            by_name[node]["parameters"][name] = text
