"""A process of a run that hangs or is killed, for rigs that measure what follows."""

from __future__ import annotations

import json
import os
import signal
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Hang:
    """The signal that a process gets: SIGSTOP makes it hang, SIGKILL ends it."""

    process: str
    number: signal.Signals = signal.SIGSTOP


def process_state(folder: Path, name: str) -> dict[str, Any]:
    """Return a process in the last state of a run, whose list of processes is called `stages`; {} if it is not there."""
    processes = json.loads((folder / "state.json").read_text()).get("stages", [])
    return next((process for process in processes if process["name"] == name), {})


def send(folder: Path, hang: Hang) -> int:
    """Send the signal; return the PID of the process."""
    pid = int(process_state(folder, hang.process)["pid"])
    os.kill(pid, hang.number)
    return pid


def is_replaced(folder: Path, name: str, pid: int) -> bool:
    """Return whether the process that had this PID was replaced by one that is up."""
    current = process_state(folder, name)
    return current.get("pid") not in (pid, None) and current.get("phase") == "up"
