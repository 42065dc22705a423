"""What is up on this machine: a folder of each host in /run/lupin-host, and cgroups of its name; the sweep of leftovers."""

from __future__ import annotations

import json
import os
import shutil
import time
from dataclasses import dataclass
from pathlib import Path

from lupin_sim.host.missing import cgroup_roots

STATE = Path("/run/lupin-host")
CGROUP = "lupin-host"
REMOVAL_LIMIT_S = 2.0


@dataclass(frozen=True)
class Keeping:
    """Which process keeps a host, so surely that a PID used again isn't taken for it."""

    pid: int
    started: int  # clock ticks after boot

    @property
    def alive(self) -> bool:
        return started(self.pid) == self.started


def started(pid: int) -> int | None:
    """When a process started, in clock ticks after boot (proc(5), field 22); None where there is none."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    except OSError:
        return None
    return None if fields[0] in "ZX" else int(fields[19])


def write(folder: Path, pid: int) -> None:
    """Note who keeps the host in this folder."""
    (folder / "keeper").write_text(json.dumps({"pid": pid, "started": started(pid)}))


def read(folder: Path) -> Keeping | None:
    """Who keeps the host in this folder; None where nobody could say."""
    try:
        return Keeping(**json.loads((folder / "keeper").read_text()))
    except (OSError, ValueError, TypeError):
        return None


def running() -> list[str]:
    """The names of all hosts that are up."""
    if not STATE.is_dir():
        return []
    return sorted(folder.name for folder in STATE.iterdir() if (keeping := read(folder)) is not None and keeping.alive)


def sweep() -> list[str]:
    """Remove what hosts left whose keeper is gone: the kernel ended their processes, mounts and namespaces with it, so only
    folders and empty cgroups are left. Returns their names."""
    swept = []
    for folder in sorted(STATE.iterdir()) if STATE.is_dir() else ():
        keeping = read(folder)
        # A folder without a note is being made right now, or its maker was killed over it.
        if keeping is None and time.time() - folder.stat().st_mtime < 60.0:
            continue
        if keeping is None or not keeping.alive:
            remove_cgroups(folder.name)
            shutil.rmtree(folder, ignore_errors=True)
            swept.append(folder.name)
    return swept


def remove_cgroups(name: str) -> None:
    """Remove a host's cgroups; the last processes in them may take a moment to be gone."""
    deadline = time.monotonic() + REMOVAL_LIMIT_S
    for base in cgroup_roots():
        top = base / f"{CGROUP}-{name}"
        folders = [Path(path) for path, _, _ in os.walk(top, topdown=False)]
        for folder in folders:
            while True:
                try:
                    folder.rmdir()
                except FileNotFoundError:
                    break
                except OSError:
                    if time.monotonic() > deadline:
                        break
                    time.sleep(0.02)
                else:
                    break
