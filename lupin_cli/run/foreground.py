"""Run one process of the stack in the foreground, on the graph of a live run or of this shell."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from lupin_cli.terminal import echo
from lupin_runtime.stack.runs import RunError, find_live_run
from lupin_runtime.stack.table import Launch


def graph_of(run: str | None) -> tuple[dict[str, str], Path]:
    """Return the environment that joins the graph of the live run `run`, or of the only one, and the run's folder.

    Without a live run, return this shell's environment and a temporary folder. Raises RunError if `run` is not up.
    """
    environment = dict(os.environ)
    try:
        found = find_live_run(run)
    except RunError:
        if run is not None:
            raise
        echo("no run is up: the process joins the graph of this shell", err=True)
        return environment, Path(tempfile.mkdtemp(prefix="lupin-"))
    environment.update(found.info()["environment"])
    return environment, found.path


def run_in_foreground(launch: Launch, environment: dict[str, str], folder: Path) -> int:
    """Run a process until it exits; return its exit status. Ctrl-C reaches the process too."""
    child = start_in_foreground(launch, environment, folder)
    while True:
        try:
            return child.wait()
        except KeyboardInterrupt:
            continue  # the terminal sent SIGINT to the child too, which shuts down by itself


def start_in_foreground(launch: Launch, environment: dict[str, str], folder: Path) -> subprocess.Popen[bytes]:
    """Start a process; its configuration is written to `folder`."""
    arguments = launch.arguments
    if launch.config is not None:
        path = folder / f"{launch.row.name}-foreground.json"
        path.write_text(json.dumps(launch.config))
        arguments = [*arguments[:-1], str(path)]
    # The child exits at the end of its input. It gets a pipe, so that Ctrl-D in the terminal does not terminate it.
    return subprocess.Popen([sys.executable, *arguments], env=environment, stdin=subprocess.PIPE)
