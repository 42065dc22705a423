"""Processor time and memory of a process, from /proc: the robot's Python has no psutil."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

_TICKS_PER_S = os.sysconf("SC_CLK_TCK")
# proc(5): ppid, utime, stime and starttime are fields 4, 14, 15 and 22 of /proc/PID/stat, counted from 1; field 3 follows the
# name in parentheses.
_PARENT, _UTIME, _STIME, _START = 4 - 3, 14 - 3, 15 - 3, 22 - 3


def cpu_time_s(pid: int | str) -> float | None:
    """Return the processor time that a process has used so far, in seconds; None if the process does not exist."""
    try:
        fields = _stat_fields(Path(f"/proc/{pid}/stat"))
    except OSError:
        return None
    return (int(fields[_UTIME]) + int(fields[_STIME])) / _TICKS_PER_S


def memory_mb(pid: int | str) -> float | None:
    """Return the memory of a process in MB, including its share of shared pages (PSS); None if it cannot be read."""
    try:
        text = Path(f"/proc/{pid}/smaps_rollup").read_text()
    except OSError:
        return None
    for line in text.splitlines():
        if line.startswith("Pss:"):
            return int(line.split()[1]) * 1024 / 1e6
    return None


def descendants_by_pid() -> Callable[[int], list[int]]:
    """Return a function that lists the children of a process and theirs, as of now."""
    children: dict[int, list[int]] = {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                parent = int(_stat_fields(folder / "stat")[_PARENT])
            except OSError:
                continue  # it has just exited
            children.setdefault(parent, []).append(int(folder.name))

    def descendants(pid: int) -> list[int]:
        found = list(children.get(pid, ()))
        for child in found:
            found += children.get(child, ())
        return found

    return descendants


class Activity(NamedTuple):
    """What a process does: whether any thread waits for a processor or a disk, and its processor time so far in seconds."""

    waiting: bool
    cpu_s: float


def activity(pid: int) -> Activity | None:
    """Return what a process does now; None if it does not exist."""
    waiting, ticks = False, 0
    try:
        for task in Path(f"/proc/{pid}/task").iterdir():
            fields = _stat_fields(task / "stat")
            waiting = waiting or fields[0] in ("R", "D")
            ticks += int(fields[_UTIME]) + int(fields[_STIME])
    except OSError:
        return None
    return Activity(waiting, ticks / _TICKS_PER_S)


def start_ticks(pid: int) -> int | None:
    """Return when a process started, in clock ticks since boot. With the PID this identifies the process until a reboot."""
    try:
        return int(_stat_fields(Path(f"/proc/{pid}/stat"))[_START])
    except OSError:
        return None


def _stat_fields(path: Path) -> list[str]:
    """Return the fields of a `stat` file from the third, the state, on. Raises OSError."""
    return path.read_text(errors="replace").rpartition(")")[2].split()
