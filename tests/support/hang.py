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


def stage(folder: Path, name: str) -> dict[str, Any]:
    """Return a process of a run's last state; {} if it is not there."""
    stages = json.loads((folder / "state.json").read_text()).get("stages", [])
    return next((stage for stage in stages if stage["name"] == name), {})


def send(folder: Path, hang: Hang) -> int:
    """Send the signal; return the PID of the process."""
    pid = int(stage(folder, hang.process)["pid"])
    os.kill(pid, hang.number)
    return pid


def is_replaced(folder: Path, name: str, pid: int) -> bool:
    """Return whether the process that had this PID was replaced by one that is up."""
    current = stage(folder, name)
    return current.get("pid") not in (pid, None) and current.get("phase") == "up"
