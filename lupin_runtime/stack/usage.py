"""Processor time and memory of a process, from /proc: the robot's Python has no psutil."""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple

_TICKS_PER_S = os.sysconf("SC_CLK_TCK")
# proc(5): utime, stime and starttime are fields 14, 15 and 22 of /proc/PID/stat, counted from 1; field 3 follows the name in
# parentheses.
_UTIME, _STIME, _START = 14 - 3, 15 - 3, 22 - 3


def cpu_time_s(pid: int | str) -> float | None:
    """Processor time that a process has used so far, in seconds; None where the process does not exist."""
    try:
        fields = _stat_fields(Path(f"/proc/{pid}/stat"))
    except OSError:
        return None
    return (int(fields[_UTIME]) + int(fields[_STIME])) / _TICKS_PER_S


def memory_mb(pid: int | str) -> float | None:
    """Memory of a process in MB, including its proportional share of shared pages (PSS); None where it cannot be read."""
    try:
        text = Path(f"/proc/{pid}/smaps_rollup").read_text()
    except OSError:
        return None
    for line in text.splitlines():
        if line.startswith("Pss:"):
            return int(line.split()[1]) * 1024 / 1e6
    return None


class Activity(NamedTuple):
    """What a process does: whether any thread waits for a processor or a disk, and its processor time so far in seconds."""

    waiting: bool
    cpu_s: float


def activity(pid: int) -> Activity | None:
    """What a process does now; None where it does not exist."""
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
    """The time at which a process started, in clock ticks since boot: with the PID it identifies the process until a reboot."""
    try:
        return int(_stat_fields(Path(f"/proc/{pid}/stat"))[_START])
    except OSError:
        return None


def _stat_fields(path: Path) -> list[str]:
    """The fields of a `stat` file from the third on, which is the state. Raises OSError."""
    return path.read_text(errors="replace").rpartition(")")[2].split()
