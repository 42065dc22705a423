"""Starts the stack in the background for a benchmark."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Sequence

from lupin_runtime.stack.runs import Run, find_live_run

UP_TIMEOUT_S = 120.0


def start_run(arguments: Sequence[str]) -> Run:
    """Start `lupin up --detach --headless` with these arguments, wait until it is up, and take over the run's environment.

    Stops the benchmark with the reason where the run does not come up.
    """
    command = [sys.executable, "-m", "lupin_cli.app", "up", "--detach", "--headless", *arguments]
    up = subprocess.run(command, check=False, timeout=60, stdout=subprocess.PIPE, text=True)
    started = re.match(r"run (\S+) has started", up.stdout)
    if started is None:
        raise SystemExit(up.returncode or 1)
    run = find_live_run(started[1])  # by its id, since other runs may be up
    deadline = time.monotonic() + UP_TIMEOUT_S
    while not (stages := run.state().get("stages")) or any(stage["phase"] != "up" for stage in stages):
        if time.monotonic() > deadline:
            raise SystemExit(f"the stack was not up within {UP_TIMEOUT_S:.0f} s: lupin logs {run.id}")
        time.sleep(0.2)
    os.environ.update(run.info()["environment"])
    return run


def stop_run(run: Run) -> None:
    """Stop the run."""
    subprocess.run([sys.executable, "-m", "lupin_cli.app", "down", "--run", run.id], check=False, timeout=90)
