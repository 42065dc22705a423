"""What auto-home last did, which it writes to a file for the light strip and for `lupin onboard status`."""

from __future__ import annotations

import contextlib
import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path

from lupin_runtime.atomic_file import read_json_object, write_atomically

FOLDER = Path("/run/lupin-auto-home")  # systemd creates it when the unit first starts after a boot, and keeps it
NAME = "report.json"

ACTIVATING = "activating"  # waits for the vendor's controllers and for the arm's service, and activates what is not active
HOMING = "homing"
HOME = "home"  # the arm was sent home
FAILED = "failed"
ESTOPPED = "e-stopped"  # the e-stop was pressed, so the arm was not moved
OFF = "off"  # LUPIN_AUTO_HOME disables it
RUNNING = (ACTIVATING, HOMING)


@dataclass(frozen=True)
class HomeReport:
    """One of the states above, its reason, and the process that wrote it."""

    state: str
    reason: str = ""
    pid: int = 0


def write_report(state: str, reason: str = "") -> None:
    """Replace the report. Writes nothing where the unit has not run since the boot; errors of the file system are ignored."""
    folder = Path(os.environ.get("RUNTIME_DIRECTORY") or FOLDER)
    if folder.is_dir():
        with contextlib.suppress(OSError):
            write_atomically(folder / NAME, json.dumps(asdict(HomeReport(state, reason, os.getpid()))) + "\n")


def read_report(folder: Path = FOLDER) -> HomeReport | None:
    """Return the last report; None without one. One whose process ended without a result is FAILED."""
    plain = read_json_object(folder / NAME)
    state, reason, pid = plain.get("state"), plain.get("reason"), plain.get("pid")
    if not (isinstance(state, str) and isinstance(reason, str) and isinstance(pid, int)):
        return None
    if state in RUNNING and not Path(f"/proc/{pid}").exists():
        return HomeReport(FAILED, "auto-home was ended before the arm was home", pid)
    return HomeReport(state, reason, pid)
