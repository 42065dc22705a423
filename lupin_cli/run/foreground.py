"""Run one process of the stack in the foreground, on the graph of a live run or of this shell."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from lupin_cli.terminal import echo, is_interactive, status_line
from lupin_runtime.atomic_file import write_atomically
from lupin_runtime.heartbeat import SUPERVISOR_PERIOD_S
from lupin_runtime.interpreter import PYTHON
from lupin_runtime.stack.liveness import Liveness
from lupin_runtime.stack.recorded import processes_of
from lupin_runtime.stack.runs import PROCESS_UMASK, Run, RunError, find_live_run, live_runs
from lupin_runtime.stack.table import Launch, ProcessRow
from lupin_runtime.stack.takeover import claim_place, holder_of

REPLACED_WITHIN_S = 10.0  # the supervisor kills what has not ended after STOP_GRACE_S


class Occupied(RuntimeError):
    """The process runs in the run already. With `may_replace`, `--replace` would end it first."""

    def __init__(self, message: str, *, may_replace: bool) -> None:
        super().__init__(message)
        self.may_replace = may_replace


@dataclass(frozen=True)
class JoinedGraph:
    """The environment that joins a graph, a folder for a process's files, and the live run whose graph it is, if any."""

    environment: dict[str, str]
    folder: Path
    run: Run | None


def graph_of(run: str | None) -> JoinedGraph:
    """Return the graph of the live run `run`, or of the only one; this shell's if no run is up. Raises RunError."""
    environment = dict(os.environ)
    try:
        found = find_live_run(run)
    except RunError:
        if run is not None or live_runs():
            raise
        echo("no run is up: the process joins the graph of this shell", err=True)
        return JoinedGraph(environment, Path(tempfile.mkdtemp(prefix="lupin-")), None)
    environment.update(found.info()["environment"])
    return JoinedGraph(environment, found.path, found)


def take_place(run: Run, row: ProcessRow, *, replace: bool) -> int:
    """Take the place of a process in a live run; return a descriptor that holds it until it is closed.

    The run's own process is ended first, if `replace` allows it. Raises Occupied and RunError.
    """
    stage = next((stage for stage in run.state().get("stages", []) if stage["name"] == row.name), None)
    occupied = stage is not None and stage["phase"] not in ("failed", "stopped")
    if stage is not None and occupied:
        what = f"process {stage['pid']}" if stage["pid"] else f"{stage['phase']}"
        taken = f"{row.name} already runs in run {run.id}: {what}"
        if not row.may_be_replaced:
            raise Occupied(f"{taken}; the run needs it and cannot go on without it", may_replace=False)
        if not replace:
            raise Occupied(taken, may_replace=holder_of(run, row.name) is None)
    claim = claim_place(run, row.name)
    own = next((process for process in processes_of(run) if process.name == row.name), None)
    deadline = time.monotonic() + REPLACED_WITHIN_S
    with status_line(f"ending {row.name} of run {run.id}", shown=is_interactive()):
        while occupied and own is not None and own.exists():
            if time.monotonic() > deadline:
                os.close(claim)
                raise RunError(f"{row.name} of run {run.id} did not end within {REPLACED_WITHIN_S:.0f} s; see: lupin status")
            time.sleep(0.05)
    return claim


def run_in_foreground(launch: Launch, environment: dict[str, str], folder: Path) -> int:
    """Run a process until it exits; return its exit status. Ctrl-C reaches the process too.

    A process that hangs is killed, as by the supervisor of a run, which then starts its own again.
    """
    channel, standard_input = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with standard_input:
        child = start_in_foreground(launch, environment, folder, standard_input.fileno())
    liveness = Liveness()
    liveness.monitor(launch.row.name, child.pid, channel, launch.row.commands_motion)
    liveness.start()
    try:
        while True:
            liveness.record_main_loop_iteration()
            with suppress(KeyboardInterrupt):  # the terminal sent SIGINT to the child too, which shuts down by itself
                with suppress(subprocess.TimeoutExpired):
                    return child.wait(SUPERVISOR_PERIOD_S)
                for silence in liveness.hung().values():
                    echo(f"{launch.row.name} did not respond for {silence.wall_s:.1f} s and was killed", err=True)
                    child.kill()
                    return child.wait()
    finally:
        liveness.close()
        liveness.stop_monitoring(launch.row.name)


def start_in_foreground(
    launch: Launch, environment: dict[str, str], folder: Path, standard_input: int = subprocess.PIPE
) -> subprocess.Popen[bytes]:
    """Start a process; its configuration is written to `folder`."""
    arguments = launch.arguments
    if launch.config is not None:
        path = folder / f"{launch.row.name}-foreground.json"
        write_atomically(path, json.dumps(launch.config))
        arguments = [*arguments[:-1], str(path)]
    # The child exits at the end of its input. It gets a pipe, so that Ctrl-D in the terminal does not terminate it.
    return subprocess.Popen([*PYTHON, *arguments], env=environment, stdin=standard_input, umask=PROCESS_UMASK)
