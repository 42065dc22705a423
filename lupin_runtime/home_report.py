"""What auto-home last did, which it writes to a file for the light strip and for `lupin onboard status`."""

from __future__ import annotations

import contextlib
import json
import math
import os
import time
from dataclasses import dataclass, field
from pathlib import Path

from lupin_runtime.atomic_file import read_json_object, write_atomically

FOLDER = Path("/run/lupin-auto-home")  # systemd creates it when the unit first starts after a boot, and keeps it
NAME = "report.json"

ACTIVATING = "activating"  # waits for the vendor's controllers and for the arm's service, and activates what is not active
HOMING = "homing"
HOME = "home"  # the arm was sent home
RETRYING = "retrying"  # it failed at boot, and systemd starts it again
FAILED = "failed"
ESTOPPED = "e-stopped"  # the e-stop was pressed, so the arm was not moved
OFF = "off"  # LUPIN_AUTO_HOME disables it, or somebody used the arm first
RUNNING = (ACTIVATING, HOMING)
UNSOLVED = (RETRYING, FAILED, ESTOPPED)  # the arm is not home
RETRY_LIMIT_S = 60.0  # after which it is not started again: the unit has RestartSec=15, and checks its release first


@dataclass(frozen=True)
class HomeReport:
    """One of the states above, its reason, the process that wrote it, and when it did, in seconds since the boot."""

    state: str
    reason: str = ""
    pid: int = 0
    at_s: float = field(default=math.inf, compare=False)


def write_report(state: str, reason: str = "") -> None:
    """Replace the report. Writes nothing where the unit has not run since the boot; errors of the file system are ignored."""
    folder = own_folder()
    if folder.is_dir():
        with contextlib.suppress(OSError):
            write_atomically(
                folder / NAME,
                json.dumps({"state": state, "reason": reason, "pid": os.getpid(), "at_s": since_boot_s()}) + "\n",
            )


def write_left_alone(before: HomeReport | None, reason: str) -> None:
    """Report that the arm was not moved, for this reason; what was unsolved before still is."""
    is_unsolved = before is not None and before.state in UNSOLVED
    write_report(*((before.state, before.reason) if before is not None and is_unsolved else (OFF, reason)))


def own_folder() -> Path:
    """Return the folder that auto-home's process writes to."""
    return Path(os.environ.get("RUNTIME_DIRECTORY") or FOLDER)


def read_report(folder: Path = FOLDER) -> HomeReport | None:
    """Return the last report; None without one. One whose process ended without a result is FAILED."""
    plain = read_json_object(folder / NAME)
    state, reason, pid = plain.get("state"), plain.get("reason"), plain.get("pid")
    if not (isinstance(state, str) and isinstance(reason, str) and isinstance(pid, int)):
        return None
    if state in RUNNING and not Path(f"/proc/{pid}").exists():
        return HomeReport(FAILED, "auto-home was ended before the arm was home", pid)
    at_s = plain.get("at_s")
    at_s = float(at_s) if isinstance(at_s, (int, float)) else -math.inf
    if state == RETRYING and since_boot_s() - at_s > RETRY_LIMIT_S:
        state = FAILED
    return HomeReport(state, reason, pid, at_s)


def since_boot_s() -> float:
    """Return the time since the boot, which another process measures alike."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)
