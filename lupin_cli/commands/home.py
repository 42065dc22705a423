"""`lupin home`: controllers active, arm at rest."""

from __future__ import annotations

import os
import subprocess
import sys

import typer

from lupin_cli.config import load
from lupin_cli.robot_options import CONFIG, ROBOT, connect, reporting, select

MODULE = "lupin_runtime.arm.auto_home"
BOUND_S = 240.0
AT_REST, NOT_AT_REST, NOTHING_THERE = 0, 1, 3


def command(
    robot: ROBOT = None,
    run: str = typer.Option(None, "--run", help="A part of a simulated run's name, where several are up."),
    patience_s: float = typer.Option(5.0, "--patience", min=0.0, help="Seconds for the vendor to load a missing controller."),
    config: CONFIG = None,
) -> None:
    """Bring the controllers to active, then send the arm to its home pose; say what was found and what was done.

    Acts on the run that is up on this machine, or on a robot with --robot: there it is the program that its boot runs.
    Exit status: 0 the arm was sent home, 1 it was not, with the reason; 2 usage, 3 no run is up or the robot can't be reached.
    """
    arguments = ("--patience", str(patience_s))
    if robot is None:
        raise typer.Exit(_here(run, arguments))
    if run is not None:
        raise typer.BadParameter("a run is on this machine; leave --robot out", param_hint="--run")
    from lupin_cli.onboard import NOT_DEPLOYED, RELEASE, run_program

    status = AT_REST
    with reporting("home"):
        inventory = load(config)
        for one in select(inventory, robot):
            with connect(one, inventory) as target:
                output = run_program(target, one, MODULE, *arguments, bound_s=BOUND_S, on_line=typer.echo)
            if output.status == NOT_DEPLOYED:
                typer.echo(f"{one.name} has no release of Lupin under {RELEASE}; next: lupin deploy robot", err=True)
            elif output.status is None:
                typer.echo(f"{one.name}: {output.stderr.strip()}; next: lupin doctor --robot {one.name}", err=True)
            status = AT_REST if output.status == 0 and status == AT_REST else NOT_AT_REST
    raise typer.Exit(status)


def _here(run: str | None, arguments: tuple[str, ...]) -> int:
    """The same program on the graph of a live run."""
    from lupin_runtime.stack.runs import RunError, find_live_run

    try:
        environment = find_live_run(run).info()["environment"]
    except RunError as error:
        typer.echo(f"{error}; for a robot: lupin home --robot NAME", err=True)
        return NOTHING_THERE
    process = subprocess.Popen([sys.executable, "-u", "-m", MODULE, *arguments], env={**os.environ, **environment})
    try:
        return AT_REST if process.wait(BOUND_S) == 0 else NOT_AT_REST
    except subprocess.TimeoutExpired:
        typer.echo(f"no end within {BOUND_S:g} s; what runs: lupin status", err=True)
        return NOT_AT_REST
    finally:
        if process.poll() is None:
            process.terminate()
            process.wait(5.0)
