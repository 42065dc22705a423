"""The hosts on this machine: each has a folder in /run/lupin-host and cgroups named after it. Removes what dead hosts left."""

from __future__ import annotations

import json
import os
import shutil
import time
from dataclasses import dataclass
from pathlib import Path

from lupin_runtime.json_text import parse_json
from lupin_sim.host.prerequisites import cgroup_roots

STATE = Path("/run/lupin-host")
CGROUP = "lupin-host"
DAEMON_FILE = "keeper"  # records the daemon of a host; must not change, since hosts of earlier versions have it too
NEW_FOLDER_GRACE_S = 60.0
REMOVAL_TIMEOUT_S = 2.0


@dataclass(frozen=True)
class DaemonProcess:
    """A host's daemon: its PID, and its start in clock ticks after boot, which distinguishes it from a reuse of the PID."""

    pid: int
    started: int

    @property
    def alive(self) -> bool:
        """Whether it still runs."""
        return start_time(self.pid) == self.started


def start_time(pid: int) -> int | None:
    """Return when a process started, in clock ticks after boot (proc(5), field 22); None if there is no such process."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    except OSError:
        return None
    return None if fields[0] in "ZX" else int(fields[19])


def write(folder: Path, pid: int) -> None:
    """Record the daemon of the host in this folder."""
    (folder / DAEMON_FILE).write_text(json.dumps({"pid": pid, "started": start_time(pid)}))


def read(folder: Path) -> DaemonProcess | None:
    """Return the daemon of the host in this folder; None if it is not recorded."""
    try:
        found = DaemonProcess(**parse_json((folder / DAEMON_FILE).read_text()))
    except (OSError, ValueError, TypeError):
        return None
    # A PID below 2 would stand for many processes, or for init, when the daemon is killed.
    return found if type(found.pid) is int and found.pid > 1 and type(found.started) is int else None


def running() -> list[str]:
    """Return the names of all hosts that are up."""
    if not STATE.is_dir():
        return []
    return sorted(folder.name for folder in STATE.iterdir() if (daemon := read(folder)) is not None and daemon.alive)


def remove_stale() -> list[str]:
    """Remove what hosts with a dead daemon left; returns their names.

    The kernel removed their processes, mounts and namespaces with the daemon, so only folders and empty cgroups are left.
    """
    removed = []
    for folder in sorted(STATE.iterdir()) if STATE.is_dir() else ():
        daemon = read(folder)
        # Without a record, the host is being started right now, or its starter was killed.
        if daemon is None and time.time() - folder.stat().st_mtime < NEW_FOLDER_GRACE_S:
            continue
        if daemon is None or not daemon.alive:
            remove_cgroups(folder.name)
            shutil.rmtree(folder, ignore_errors=True)
            removed.append(folder.name)
    return removed


def remove_cgroups(name: str) -> None:
    """Remove a host's cgroups. Waits for the last processes in them to exit, for at most REMOVAL_TIMEOUT_S."""
    deadline = time.monotonic() + REMOVAL_TIMEOUT_S
    for base in cgroup_roots():
        top = base / f"{CGROUP}-{name}"
        for folder in [Path(path) for path, _, _ in os.walk(top, topdown=False)]:
            while True:
                try:
                    folder.rmdir()
                    break
                except FileNotFoundError:
                    break
                except OSError:
                    if time.monotonic() > deadline:
                        break
                    time.sleep(0.02)
