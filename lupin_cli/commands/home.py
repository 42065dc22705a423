"""`lupin home`: activate the controllers and send the arm home."""

from __future__ import annotations

import os
import subprocess
import sys

import typer

from lupin_cli.connection.inventory import load
from lupin_cli.connection.options import CONFIG, ROBOT, connect, reporting_errors, select_robots
from lupin_cli.exit_codes import FAILURE, SUCCESS, UNREACHABLE
from lupin_cli.terminal import echo

MODULE = "lupin_runtime.arm.auto_home"
TIMEOUT_S = 240.0


def command(
    robot: ROBOT = None,
    run: str = typer.Option(None, "--run", help="Select the simulated run by part of its id, if several are up."),
    patience_s: float = typer.Option(5.0, "--patience", min=0.0, help="Wait this many seconds for a missing controller."),
    config: CONFIG = None,
) -> None:
    """Activate the controllers, then send the arm to its home pose; report what was found and done.

    Acts on the run on this machine; with --robot on a robot, which runs the same program when it boots.
    Exit status: 0 the arm was sent home, 1 it was not (the reason is printed), 2 usage, 3 no run is up or the robot cannot be
    reached.
    """
    arguments = ("--patience", str(patience_s))
    if robot is None:
        raise typer.Exit(_home_local_run(run, arguments))
    if run is not None:
        raise typer.BadParameter("--run selects a run on this machine; it cannot be combined with --robot", param_hint="--run")
    from lupin_cli.release.paths import NOT_DEPLOYED, RELEASE, run_module

    status = SUCCESS
    with reporting_errors("home"):
        inventory = load(config)
        for one in select_robots(inventory, robot):
            with connect(one, inventory) as target:
                output = run_module(target, one, MODULE, *arguments, timeout_s=TIMEOUT_S, on_line=echo)
            if output.status == NOT_DEPLOYED:
                echo(f"{one.name} has no release of Lupin under {RELEASE}; next: lupin deploy robot", err=True)
            elif output.status is None:
                echo(f"{one.name}: {output.stderr.strip()}; next: lupin doctor --robot {one.name}", err=True)
            status = SUCCESS if output.status == 0 and status == SUCCESS else FAILURE
    raise typer.Exit(status)


def _home_local_run(run: str | None, arguments: tuple[str, ...]) -> int:
    """Run the program in the environment of a live run on this machine; return the exit status."""
    from lupin_runtime.stack.runs import RunError, find_live_run

    try:
        environment = find_live_run(run).info()["environment"]
    except RunError as error:
        echo(f"{error}; for a robot: lupin home --robot NAME", err=True)
        return UNREACHABLE
    process = subprocess.Popen([sys.executable, "-u", "-m", MODULE, *arguments], env={**os.environ, **environment})
    try:
        return SUCCESS if process.wait(TIMEOUT_S) == 0 else FAILURE
    except subprocess.TimeoutExpired:
        echo(f"did not finish within {TIMEOUT_S:g} s; see: lupin status", err=True)
        return FAILURE
    finally:
        if process.poll() is None:
            process.terminate()
            process.wait(5.0)
