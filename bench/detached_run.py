"""Start and stop the stack in the background, for a benchmark."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from lupin_runtime.stack.runs import Run, find_live_run

UP_TIMEOUT_S = 360.0


def start_run(arguments: Sequence[str]) -> Run:
    """Run `lupin up --detach --headless` with these arguments, wait until all stages are up, and adopt the run's environment.

    Exits with the reason if the stack does not come up; then the run is stopped. From here on SIGTERM ends this process by
    SystemExit, so that callers stop their run.
    """
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    command = [sys.executable, "-m", "lupin_cli.app", "up", "--detach", "--headless", *arguments]
    up = subprocess.run(command, check=False, timeout=UP_TIMEOUT_S, stdout=subprocess.PIPE, text=True)
    started = re.match(r"run (\S+) has started", up.stdout)
    if started is None:
        raise SystemExit(up.returncode or 1)
    run = find_live_run(started[1])  # by its id, since other runs may be live
    deadline = time.monotonic() + UP_TIMEOUT_S
    try:
        while not (stages := run.state().get("stages")) or any(stage["phase"] != "up" for stage in stages):
            if time.monotonic() > deadline:
                raise SystemExit(f"the stack was not up within {UP_TIMEOUT_S:.0f} s; see: lupin logs --run {run.id}")
            time.sleep(0.2)
    except BaseException:  # Ctrl-C, too: nobody else stops it
        stop_run(run)
        raise
    os.environ.update(run.info()["environment"])
    return run


def stop_run(run: Run) -> None:
    """Stop the run with `lupin down`."""
    subprocess.run([sys.executable, "-m", "lupin_cli.app", "down", "--run", run.id], check=False, timeout=90)


@contextmanager
def detached_run(arguments: Sequence[str]) -> Iterator[Run]:
    """Start a run as `start_run` does, and stop it after the block."""
    run = start_run(arguments)
    try:
        yield run
    finally:
        stop_run(run)
