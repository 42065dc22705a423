"""What a process uses, as /proc tells it: a robot's Python has no psutil."""

from __future__ import annotations

import os
from pathlib import Path

_TICKS_PER_S = os.sysconf("SC_CLK_TCK")
# proc(5), /proc/PID/stat: fields 14 and 15 count from 1; what follows the name in parentheses begins with field 3.
_UTIME, _STIME = 14 - 3, 15 - 3


def cpu_time_s(pid: int | str) -> float | None:
    """Processor time that a process has used so far, s; None where there is no such process."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(errors="replace").rpartition(")")[2].split()
    except OSError:
        return None
    return (int(fields[_UTIME]) + int(fields[_STIME])) / _TICKS_PER_S


def memory_mb(pid: int | str) -> float | None:
    """A process's memory, its share of what it shares with others included (PSS), MB; None where it can't be read."""
    try:
        text = Path(f"/proc/{pid}/smaps_rollup").read_text()
    except OSError:
        return None
    for line in text.splitlines():
        if line.startswith("Pss:"):
            return int(line.split()[1]) * 1024 / 1e6
    return None
