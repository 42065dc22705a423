"""`lupin env`: print the commands by which a shell joins the graph of a run."""

from __future__ import annotations

import json
import os
import shlex

import typer

from lupin_cli.completion import matching
from lupin_cli.exit_codes import UNREACHABLE
from lupin_cli.run.run_option import LIVE_RUN
from lupin_cli.terminal import echo

SHELLS = ("bash", "zsh", "fish")


def complete_shell(incomplete: str) -> list[str]:
    """Return the shells that Lupin knows."""
    return matching(SHELLS, incomplete)


def command(
    run: LIVE_RUN = None,
    shell: str = typer.Option("bash", "--shell", autocompletion=complete_shell, help="Print it for bash, zsh or fish."),
    as_json: bool = typer.Option(False, "--json", help="Print the variables as JSON."),
) -> None:
    """Print what a shell evaluates to join the graph of the run that is up: then `ros2 topic list` and others show it.

    Nothing else is printed on standard output. In fish: lupin env --shell fish | source
    Exit status: 0 printed, 2 usage, 3 no run is up.

    Example: eval "$(lupin env)"
    """
    from lupin_runtime.stack.dds import FOREIGN
    from lupin_runtime.stack.runs import RunError, find_live_run

    if shell not in SHELLS:
        raise typer.BadParameter(f"{shell!r} is none of: {', '.join(SHELLS)}", param_hint="--shell")
    try:
        variables = find_live_run(run).info().get("environment")
    except RunError as error:
        echo(str(error), err=True)
        raise typer.Exit(UNREACHABLE) from error
    joined = {str(name): str(value) for name, value in (variables if isinstance(variables, dict) else {}).items()}
    # Each of these would take the shell's programs out of the run's graph.
    foreign = [name for name in FOREIGN if name in os.environ and name not in joined]
    if as_json:
        print(json.dumps({"set": joined, "unset": foreign}))
        return
    for name, value in joined.items():
        echo(f"set -gx {name} {shlex.quote(value)}" if shell == "fish" else f"export {name}={shlex.quote(value)}", wrap=False)
    for name in foreign:
        echo(f"set -e {name}" if shell == "fish" else f"unset {name}", wrap=False)
