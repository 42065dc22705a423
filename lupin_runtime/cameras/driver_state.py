"""The state of a camera's driver, which the camera service writes to a file for the doctor."""

from __future__ import annotations

import contextlib
import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path

from lupin_runtime.atomic_file import write_atomically

STATE_FOLDER = Path("/run/lupin-cameras")  # systemd creates it with the unit, and removes it when the unit stops

OFF = "off"  # switched off in the configuration
ABSENT = "absent"  # no such camera is connected
HELD = "held"  # by another process
NO_DRIVER = "no-driver"  # the vendor's software cannot be started
RUNNING = "running"
ENDED = "ended"  # the driver exited by itself, and will be restarted


@dataclass(frozen=True)
class DriverState:
    """One of the states above, the text printed with it, and how often in a row the driver exited by itself."""

    state: str
    text: str
    ends: int = 0


def write_state(kind: str, state: DriverState) -> None:
    """Write the state of the camera `kind` to the folder that systemd names in RUNTIME_DIRECTORY.

    Writes nothing if the variable is not set; errors of the file system are ignored.
    """
    folder = os.environ.get("RUNTIME_DIRECTORY", "")
    if folder:
        with contextlib.suppress(OSError):
            write_atomically(Path(folder) / f"{kind}.json", json.dumps(asdict(state)) + "\n")
