"""`lupin home`: activate the controllers and send the arm home."""

from __future__ import annotations

import contextlib
import os
import subprocess
import threading

import typer

from lupin_cli.connection.options import CONFIG, LOCAL, ROBOT, connect, reporting_errors, select_subject
from lupin_cli.exit_codes import FAILURE, SUCCESS, UNREACHABLE, USAGE_ERROR
from lupin_cli.printed_commands import complete, lupin, print_next
from lupin_cli.run.run_option import LIVE_RUN
from lupin_cli.terminal import echo
from lupin_runtime.interpreter import PYTHON

MODULE = "lupin_runtime.arm.auto_home"
TIMEOUT_S = 240.0


def command(
    robot: ROBOT = None,
    local: LOCAL = False,
    run: LIVE_RUN = None,
    patience_s: float = typer.Option(5.0, "--patience", min=0.0, help="Wait this many seconds for a missing controller."),
    when_idle: bool = typer.Option(False, "--when-idle", help="Wait until the arm is idle instead of replacing its motion."),
    wait_s: float = typer.Option(120.0, "--wait", min=0.0, max=3600.0, help="With --when-idle, wait at most this long, s."),
    config: CONFIG = None,
) -> None:
    """Activate the controllers, then send the arm to its home pose; report what was found and done.

    Acts on the default robot, which runs the same program when it boots, or with --local on the run on this machine. If this
    command ends, or the link is lost, before the arm moves, it is not moved.
    With --when-idle, it waits until the arm has been at rest for 2 s, and no replay, recording, gamepad, calibration or mission
    uses it.

    Exit status: 0 the arm was sent home, 1 it was not (the reason is printed), 2 usage, 3 no run is up or the robot cannot be
    reached.

    Example: lupin home --robot greenhouse --when-idle
    """
    arguments: tuple[str, ...] = ("--patience", str(patience_s))
    timeout_s = TIMEOUT_S
    if when_idle:
        arguments, timeout_s = (*arguments, "--when-idle", str(wait_s)), TIMEOUT_S + wait_s
    if run is not None and not local:
        raise typer.BadParameter("--run selects a run on this machine; it needs --local", param_hint="--run")
    from lupin_cli.release.paths import NOT_DEPLOYED, RELEASE, remote_command
    from lupin_runtime.arm.consent import ANSWER, QUESTION

    status = SUCCESS
    with reporting_errors("home"):
        inventory, robots = select_subject(config, robot, local=local)
        if inventory is None:
            raise typer.Exit(_home_local_run(run, arguments, timeout_s))
        for one in robots:
            with connect(one, inventory) as target:
                # If this command ends or its link is lost meanwhile, nobody answers, and the arm is not moved.
                script = remote_command(one, MODULE, *arguments, "--ask")
                output = target.run(script, timeout_s=timeout_s, on_line=echo, answers={QUESTION: ANSWER})
            if output.status in (NOT_DEPLOYED, USAGE_ERROR):
                release = "no release of Lupin" if output.status == NOT_DEPLOYED else "an older release of Lupin"
                echo(f"lupin home: {one.name} has {release} under {RELEASE}", err=True)
                print_next(lupin("deploy", "robot", robot=one.name))
            elif output.status is None:
                echo(f"lupin home: {one.name}: {output.stderr.strip()}", err=True)
                print_next(lupin("doctor", robot=one.name))
            elif output.status:
                print_next(complete("journalctl -b -u mirte-ros -u lupin-onboard -n 50", login=target.login_command))
            status = SUCCESS if output.status == 0 and status == SUCCESS else FAILURE
    raise typer.Exit(status)


def _home_local_run(run: str | None, arguments: tuple[str, ...], timeout_s: float) -> int:
    """Run the program in the environment of a live run on this machine; return the exit status."""
    from lupin_runtime.arm.consent import ANSWER, QUESTION
    from lupin_runtime.stack.runs import RunError, find_live_run

    try:
        environment = find_live_run(run).info()["environment"]
    except RunError as error:
        echo(f"lupin home: {error}", err=True)
        return UNREACHABLE
    command = [*PYTHON, "-u", "-m", MODULE, *arguments, "--ask"]
    # As over SSH, it moves nothing once this process has ended, in whatever way.
    pipe, variables = subprocess.PIPE, {**os.environ, **environment}
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, env=variables) as process:
        assert process.stdin is not None and process.stdout is not None
        watchdog = threading.Timer(timeout_s, process.kill)
        watchdog.start()
        try:
            for line in process.stdout:
                if line.rstrip() != QUESTION:
                    echo(line.rstrip())
                    continue
                with contextlib.suppress(BrokenPipeError):  # its status says why it has ended
                    process.stdin.write(ANSWER.decode())
                    process.stdin.flush()
            status = process.wait(5.0)
        except BaseException:
            process.kill()
            raise
        finally:
            is_late = not watchdog.is_alive()
            watchdog.cancel()
    if is_late:
        echo(f"did not finish within {timeout_s:g} s; see: lupin status", err=True)
    return SUCCESS if status == 0 else FAILURE
