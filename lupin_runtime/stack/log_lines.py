"""The lines of a process's log: their time and level, and what they say about why a process has ended.

A node of rclpy writes `[INFO] [1795515361.498342132] [node]: text`. Other lines, such as those of a stack trace, have neither
time nor level: they belong to the line before.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from lupin_runtime.bounded_file import open_regular

LEVELS = ("debug", "info", "warn", "error", "fatal")
_LINE = re.compile(r"\[(DEBUG|INFO|WARN|ERROR|FATAL)\] \[(\d{1,12}\.\d{1,9})\] \[([^\]]*)\]: (.*)")
_EXCEPTION = re.compile(r"[A-Za-z_][\w.]*(Error|Exception|Exit|Interrupt|Expired|Warning)(: .*)?")
_TAIL_BYTES = 16_384
_MAX_CAUSE = 300


@dataclass(frozen=True)
class LogLine:
    """A line. `time_s` is since the epoch; it and `level` are those of the line before if the line itself has none."""

    process: str
    text: str
    node: str = ""
    time_s: float = 0.0
    level: str = ""
    continues: bool = True  # whether the line itself has no time

    def is_at_least(self, level: str) -> bool:
        """Return whether its level is `level` or a worse one. A line without one, such as `print` writes, always is."""
        return not self.level or LEVELS.index(self.level) >= LEVELS.index(level)


class LogParser:
    """Parses the lines of one process in their order."""

    def __init__(self, process: str) -> None:
        self._last = LogLine(process, "")

    def parse(self, line: str) -> LogLine:
        """Return a line with its time and level."""
        found = _LINE.fullmatch(line)
        if found is None:
            return replace(self._last, text=line, continues=True)
        level, time_s, node, text = found.groups()
        self._last = LogLine(self._last.process, text, node, float(time_s), level.lower(), continues=False)
        return self._last


def merged(logs: Sequence[Sequence[LogLine]]) -> list[LogLine]:
    """Return the lines of several processes by time; those of one process keep their order."""
    latest = []
    for lines in logs:
        time_s = 0.0
        for line in lines:
            time_s = max(time_s, line.time_s)  # the clock was set back: the order of the file counts
            latest.append((time_s, line))
    return [line for _, line in sorted(latest, key=lambda pair: pair[0])]


def cause_in_log(path: Path) -> str:
    """Return why a process has exited, from its log: an exception, else its last error, else what it printed last."""
    try:
        with open_regular(path) as log:
            log.seek(max(0, os.fstat(log.fileno()).st_size - _TAIL_BYTES))
            lines = [line.strip() for line in log.read().decode(errors="replace").splitlines() if line.strip()]
    except OSError:
        return ""
    exceptions = [line for line in lines if _EXCEPTION.fullmatch(line)]
    errors = [found[4] for line in lines if (found := _LINE.fullmatch(line)) and found[1] in ("ERROR", "FATAL")]
    printed = [line for line in lines if not _LINE.fullmatch(line)]
    return (exceptions or errors or printed or [""])[-1][:_MAX_CAUSE]
