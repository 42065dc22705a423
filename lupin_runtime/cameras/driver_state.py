"""What the process that runs a camera's driver last did: a file of the camera service, which the doctor reads."""

from __future__ import annotations

import contextlib
import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path

from lupin_runtime.atomic_file import write_atomically

STATE_FOLDER = Path("/run/lupin-cameras")  # systemd creates it with the unit, and removes it when the unit stops

OFF = "off"  # by the configuration
ABSENT = "absent"  # no such camera is connected
HELD = "held"  # by a process that is no camera driver
NO_DRIVER = "no-driver"  # the vendor's software cannot be started
RUNNING = "running"
ENDED = "ended"  # the driver ended by itself, and is started again


@dataclass(frozen=True)
class DriverState:
    """One of the states above, what was printed about it, and how often in a row the driver ended by itself."""

    state: str
    text: str
    ends: int = 0


def write_state(kind: str, state: DriverState) -> None:
    """Replace the state of the camera `kind`. Without the folder that systemd names, or space in it, nothing is written."""
    folder = os.environ.get("RUNTIME_DIRECTORY", "")
    if folder:
        with contextlib.suppress(OSError):
            write_atomically(Path(folder) / f"{kind}.json", json.dumps(asdict(state)) + "\n")
