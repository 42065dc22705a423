"""`lupin down`: stop a run."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import typer

from lupin_cli.exit_codes import FAILURE, UNREACHABLE
from lupin_cli.run.run_option import LIVE_RUN
from lupin_cli.terminal import echo, is_interactive, status_line

if TYPE_CHECKING:
    from lupin_runtime.stack.recorded import RecordedProcess
    from lupin_runtime.stack.runs import Run

STOP_TIMEOUT_S = 30.0
HUNG_TIMEOUT_S = 5.0  # for a supervisor that does not respond
# The processes of a killed supervisor exit by themselves within 5 s, unless they hang too.
ORPHAN_TIMEOUT_S = 7.0


def command(
    run: LIVE_RUN = None,
    everything: bool = typer.Option(False, "--all", help="Stop every run of this user."),
    dry_run: bool = typer.Option(False, "--dry-run", help="Only print which runs would be stopped."),
) -> None:
    """Stop a run and all its processes. Those that do not stop are killed.

    Exit status: 0 stopped (or no run was up with --all), 1 not stopped, 3 no such run.

    Example: lupin down
    """
    from lupin_runtime.stack.recorded import supervisor_of
    from lupin_runtime.stack.runs import RunError, find_live_run, live_runs

    try:
        found = live_runs() if everything else [find_live_run(run)]
    except RunError as error:
        echo(str(error), err=True)
        raise typer.Exit(UNREACHABLE) from error
    stopped = True
    for one in found:
        supervisor = supervisor_of(one)
        if dry_run:
            echo(f"would stop run {one.id} (supervisor {supervisor.pid})")
        else:
            with status_line(f"stopping run {one.id}", shown=is_interactive()):
                stopped = _stop(one, supervisor) and stopped
    if not stopped:
        raise typer.Exit(FAILURE)


def _stop(run: Run, supervisor: RecordedProcess) -> bool:
    from lupin_runtime.stack.alarms import supervisor_silent_s
    from lupin_runtime.stack.recorded import processes_of

    if not supervisor.signal(signal.SIGTERM):
        echo(f"run {run.id}: its files name no existing supervisor; find it with: fuser {run.path / 'lock'}", err=True)
        return False
    hung = supervisor_silent_s(run.state()) > 0.0
    supervisor.signal(signal.SIGCONT)  # a process that SIGSTOP suspended handles SIGTERM only after SIGCONT
    processes = processes_of(run)
    if _wait_until(lambda: not run.is_live(), HUNG_TIMEOUT_S if hung else STOP_TIMEOUT_S):
        echo(f"run {run.id} stopped")
        return True
    killed = [supervisor] if supervisor.signal(signal.SIGKILL) else []
    _wait_until(lambda: not any(process.exists() for process in processes), ORPHAN_TIMEOUT_S)
    killed += [process for process in processes if process.signal(signal.SIGKILL)]
    names = ", ".join(process.name for process in killed)
    if not _wait_until(lambda: not run.is_live() and not any(process.exists() for process in killed), HUNG_TIMEOUT_S):
        echo(f"run {run.id} did not stop, although these were killed: {names}; restart this computer", err=True)
        return False
    echo(f"run {run.id} stopped; killed, because they did not stop: {names}")
    return True


def _wait_until(condition: Callable[[], bool], timeout_s: float) -> bool:
    deadline = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.05)
    return True
