"""`lupin run PROCESS`: run one process of the stack in the foreground, on the graph of the live run."""

from __future__ import annotations

import dataclasses
import os
import sys
from typing import TYPE_CHECKING

import typer

from lupin_cli.completion import processes
from lupin_cli.exit_codes import FAILURE, UNREACHABLE, USAGE_ERROR
from lupin_cli.printed_commands import lupin, print_next
from lupin_cli.run.run_option import LIVE_RUN
from lupin_cli.terminal import echo
from lupin_runtime.json_text import parse_json

if TYPE_CHECKING:
    from lupin_cli.run.foreground import JoinedGraph
    from lupin_runtime.stack.table import Launch, ProcessRow


def command(
    process: str = typer.Argument(
        None, autocompletion=processes, help="A process of the stack; without one, list the processes."
    ),
    run: LIVE_RUN = None,
    replace: bool = typer.Option(False, "--replace", help="End the run's own process first, and take its place."),
    parameter: list[str] = typer.Option([], "--parameter", "-p", help="Override a parameter: NODE.NAME=VALUE, VALUE as JSON."),
) -> None:
    """Run one process of the stack in the foreground, on the graph of the live run if there is one.

    If the run has the process already, it is refused; with --replace, the run's own process is ended first, and started
    again when this one ends. A process that hangs is killed. Exit status: that of the process, 1 the run has it already, 2
    usage, 3 no such run.

    Example: lupin run nav --replace -p Navigator.speed=0.2
    """
    from lupin_cli.run.foreground import Occupied, graph_of, run_in_foreground, take_place
    from lupin_runtime.stack.runs import RunError
    from lupin_runtime.stack.table import TABLE

    rows = {row.name: row for row in TABLE if not row.external}
    if process is None:
        for row in rows.values():
            echo(f"{row.name:13s} {', '.join(node.path.split(':')[1] for node in row.nodes) or _program(row)}")
        return
    if process not in rows:
        echo(f"there is no process {process!r}; the processes are: {', '.join(rows)}", err=True)
        raise typer.Exit(USAGE_ERROR)
    try:
        joined = graph_of(run)
    except RunError as error:
        echo(str(error), err=True)
        raise typer.Exit(UNREACHABLE) from error
    made = _launch(rows[process], joined)
    if made.config is not None:
        _override(made.config, parameter)
    claim = None
    try:
        if joined.run is not None:
            claim = take_place(joined.run, made.row, replace=replace)
        exit_status = run_in_foreground(made, joined.environment, joined.folder)
    except (Occupied, RunError) as error:
        echo(str(error), err=True)
        if isinstance(error, Occupied) and error.may_replace and joined.run is not None:
            print_next(lupin("run", process, "--replace", "--run", joined.run.id), "to end it first")
        raise typer.Exit(FAILURE) from error
    finally:
        if claim is not None:
            os.close(claim)
    raise typer.Exit(exit_status)


def _launch(row: ProcessRow, joined: JoinedGraph) -> Launch:
    """Return how to start a process: with the parameters that the live run gave its own, or else by the run's options."""
    from lupin_runtime.atomic_file import read_json_object
    from lupin_runtime.stack.options import Options
    from lupin_runtime.stack.table import launch, select_nodes

    stored = joined.run.info().get("options") if joined.run is not None else None
    options = Options.from_json(stored) if isinstance(stored, dict) else Options()
    options = dataclasses.replace(options, run_path=joined.folder, mission=True)
    # Without a run, nothing tells which of the row's nodes its graph lacks.
    made = launch(row if joined.run is None else select_nodes(row, options), options)
    own = read_json_object(joined.folder / "processes" / f"{row.name}.json")
    return dataclasses.replace(made, config=own) if made.config is not None and own else made


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
            by_name[node]["parameters"][name] = parse_json(text)
        except ValueError:
            by_name[node]["parameters"][name] = text
