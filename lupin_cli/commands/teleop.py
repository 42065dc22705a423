"""`lupin teleop`: drive from this terminal, and test the gamepads of this computer."""

from __future__ import annotations

from contextlib import suppress
from typing import Annotated

import typer

from lupin_cli.command_group import command_group
from lupin_cli.exit_codes import FAILURE
from lupin_cli.terminal import echo

app = command_group("Test the gamepads of this computer.", "lupin teleop test", no_args_is_help=True)


@app.callback()
def root() -> None:
    """Keep `test` a subcommand: Typer would make the only command the group itself."""


@app.command("test")
def show_events(
    seconds: Annotated[float | None, typer.Option("--seconds", min=0.0, help="End after this time [at Ctrl-C].")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object for each change, on a line.")] = False,
) -> None:
    """Show what gamepads send, which control that is, and what it would command. Sends nothing to the robot.

    A run that is up still obeys its gamepad, unless it was started with --no-joystick.

    Exit status: 0 shown, 1 no gamepad was found that can be read.

    Example: lupin teleop test --seconds 30
    """
    from lupin_cli.run.pad_test import PadTest
    from lupin_runtime.stack.runs import live_runs

    if live := live_runs():
        echo(f"run {live[0].id} is up: a gamepad that is held here may also drive its robot", err=True)
    shown = PadTest(as_json)
    with suppress(KeyboardInterrupt):
        shown.run(seconds)
    if not shown.found:
        echo("no known gamepad was connected; see what the kernel has with: cat /proc/bus/input/devices", err=True)
        raise typer.Exit(FAILURE)
