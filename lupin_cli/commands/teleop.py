"""`lupin teleop`: drive from this terminal, and test the gamepads of this computer."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Annotated, Any

import typer

from lupin_cli.command_group import command_group
from lupin_cli.exit_codes import FAILURE, NO_RESULT, UNREACHABLE, USAGE_ERROR
from lupin_cli.run.run_option import LIVE_RUN
from lupin_cli.terminal import echo, sigterm_as_ctrl_c

app = command_group(
    """Drive the robot of the live run by the keys of this terminal, and by gamepads if the run does not read them itself.

    Keys: w s a d drive, q e turn, capital letters are faster, space stops, x ends. A key counts as held for 0.3 s after its
    last repetition. The gamepad of the run, and everything else of a higher priority, overrides the keys. Gamepads also move
    the arm; the view shows what does so, and why it does not follow.

    Exit status: 0 ended, 2 this is no terminal, 3 no run is up.
    """,
    "lupin teleop",
    invoke_without_command=True,
)


def _reads_pads(stages: Sequence[Mapping[str, Any]]) -> bool:
    """Return whether a run with these stages reads the gamepads of this computer."""
    return any(stage.get("name") == "joystick" for stage in stages)


@app.callback()
def drive(context: typer.Context, run: LIVE_RUN = None) -> None:
    """Drive until x is pressed."""
    if context.invoked_subcommand is not None:
        return
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        echo("lupin teleop: needs a terminal for its keys and its view", err=True)
        raise typer.Exit(USAGE_ERROR)
    from lupin_cli.run.ros_client import join_run
    from lupin_runtime.stack.runs import RunError, find_live_run

    try:
        stages = find_live_run(run).state().get("stages", [])
    except RunError as error:
        echo(str(error), err=True)
        raise typer.Exit(UNREACHABLE) from error
    with join_run(run) as session:
        from lupin_cli.run import teleop_session

        with sigterm_as_ctrl_c(), suppress(KeyboardInterrupt):
            teleop_session.drive(session, reads_pads=not _reads_pads(stages))


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

    for live in live_runs():
        if _reads_pads(live.state().get("stages", [])):
            echo(f"run {live.id} reads the gamepads: one that is held here also drives its robot", err=True)
    shown = PadTest(as_json)
    with suppress(KeyboardInterrupt):
        shown.run(seconds)
    if not shown.found:
        echo("no known gamepad was connected; see what the kernel has with: cat /proc/bus/input/devices", err=True)
        raise typer.Exit(FAILURE)


@app.command()
def calibrate(
    device: Annotated[str, typer.Option("--device", help="Calibrate this one of several gamepads, such as event7.")] = "",
    timeout_s: Annotated[float, typer.Option("--timeout", min=0.1, help="Wait this long for each control, s.")] = 8.0,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print what would be written; write nothing.")] = False,
) -> None:
    """Learn the controls of a gamepad that is unknown or drives wrongly: asks for each, and writes them to a file.

    The file is for this gamepad with this link, USB or Bluetooth; the former one is kept as a backup. It is used when the
    gamepad is connected the next time, or a run starts.

    Exit status: 0 written, 1 the file cannot be written, or the gamepad not read, 2 there is no gamepad, or several, 3 a run
    reads the gamepads, 4 a control was not used in time.

    Example: lupin teleop calibrate --dry-run
    """
    from lupin_cli.run.pad_calibration import CalibrationFailed, find_candidates
    from lupin_cli.run.pad_calibration import calibrate as learn
    from lupin_runtime.stack.runs import live_runs
    from lupin_runtime.teleop import connected_pads
    from lupin_runtime.teleop.map_files import map_folder, map_path, map_text, write_map

    for live in live_runs():
        if _reads_pads(live.state().get("stages", [])):
            echo(f"run {live.id} drives by the gamepads; end it first: lupin down", err=True)
            raise typer.Exit(UNREACHABLE)
    found = [each for each in find_candidates(connected_pads.DEVICES, connected_pads.SYSFS) if device in ("", each.path.name)]
    if len(found) != 1:
        names = ", ".join(f"{each.path.name} ({each.label})" for each in found)
        advice = f"choose one with --device: {names}" if found else "see what the kernel has: cat /proc/bus/input/devices"
        echo(f"expected one gamepad, found {len(found)}; {advice}", err=True)
        raise typer.Exit(USAGE_ERROR)
    path = map_path(map_folder(), found[0].identity)
    echo(f"calibrating {found[0].label}; let go of all its controls first, and of each after it was asked for", err=True)
    try:
        row = learn(found[0], timeout_s, lambda prompt: echo(prompt, err=True))
    except CalibrationFailed as error:
        echo(str(error), err=True)
        raise typer.Exit(NO_RESULT) from error
    except OSError as error:
        echo(f"cannot read {found[0].path}: {error.strerror}; see docs/teleop.md", err=True)
        raise typer.Exit(FAILURE) from error
    if dry_run:
        echo(map_text(row), nl=False)
        return
    try:
        backup = write_map(path, row)
    except OSError as error:
        echo(f"cannot write {path}: {error.strerror}", err=True)
        raise typer.Exit(FAILURE) from error
    echo(f"wrote {path}" + (f"; the former one is {backup}" if backup else "") + "\ntry it with: lupin teleop test")
