"""The command journal: who asked the console for what, when, and whether it was allowed. One JSON object per line."""

from __future__ import annotations

import errno
import json
import os
import time
from collections.abc import Callable
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from lupin_runtime.console.console_events import ConsoleEvent, NumberedEvent
from lupin_runtime.console.short_text import short_repr

MAX_BYTES = 20_000_000
# A request that a client repeats within this time, such as a refused stream of velocities, is not written again, only counted.
_REPEAT_S = 1.0
# Of changes of stops and of control more are written in that time: none is missing unless a client makes a flood of them.
_MAX_EVENTS = 20
_MAX_KEYS = 1000
_MAX_REASON = 500
_MAX_DETAIL = 2000
_REOPEN_S = 5.0  # how long nothing is written after an error, such as a full disk


class CommandJournal:
    """Appends to a file that only its owner may read. Beyond MAX_BYTES the file is renamed to `.1`, replacing the last one.

    If it cannot be written, nothing is raised, since a full disk must keep nobody from stopping the robot: `warn` is called
    once, and the file is opened again later.
    """

    def __init__(self, path: Path, warn: Callable[[str], None]) -> None:
        self._path = path
        self._warn = warn
        self._descriptor: int | None = None
        self._failed_s: float | None = None  # when the file could not be written; None while it can
        # By request: when it was first written within _REPEAT_S, how often since then, and how often it was not written.
        self._last: dict[tuple[str, str, str], tuple[float, int, int]] = {}

    def record(self, session: str, what: str, detail: Any = None, refused: str = "") -> None:
        """Write a command. A long `detail` is cut. `refused` is the reason for a refusal; empty if the command was allowed.

        Never raises.
        """
        self._write_limited(session, what, detail, refused, None, 1)

    def record_event(self, event: ConsoleEvent, numbered: NumberedEvent) -> None:
        """Write a change of a stop or of control. Never raises."""
        self._write_limited(event.name, event.text, None, "", numbered, _MAX_EVENTS)

    def _write_limited(
        self, session: str, what: str, detail: Any, refused: str, event: NumberedEvent | None, at_most: int
    ) -> None:
        key = (session, what, refused)
        begun_s, written, repeats = self._last.get(key, (-_REPEAT_S, 0, 0))
        now_s = time.monotonic()
        if now_s - begun_s >= _REPEAT_S:
            begun_s, written = now_s, 0
        if written >= at_most:
            self._last[key] = (begun_s, written, repeats + 1)
            return
        if len(self._last) >= _MAX_KEYS:
            self._last.clear()
        self._last[key] = (begun_s, written + 1, 0)
        row: dict[str, Any] = {
            "time": datetime.now(timezone.utc).isoformat(timespec="milliseconds"),
            "session": session,
            "what": what,
        }
        if detail is not None:
            row["detail"] = short_repr(detail, _MAX_DETAIL)
        if refused:
            row["refused"] = refused[:_MAX_REASON]
        if event is not None:
            row["event"] = event.as_json()
        self._write({**row, "repeats": repeats} if repeats else row)

    def close(self) -> None:
        """Close the file."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None

    def _write(self, row: dict[str, Any]) -> None:
        if self._failed_s is not None and time.monotonic() - self._failed_s < _REOPEN_S:
            return
        try:
            self._append(f"{json.dumps(row)}\n".encode())
        except OSError as error:
            self.close()
            if self._failed_s is None:
                self._warn(f"the command journal is not written: {error}")
            self._failed_s = time.monotonic()
        else:
            self._failed_s = None

    def _append(self, line: bytes) -> None:
        if self._descriptor is None:
            self._descriptor = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o600)
        if self._failed_s is not None:
            line = b"\n" + line  # a disk that became full may have taken a part of the last line
        written = os.write(self._descriptor, line)
        if written < len(line):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        if os.fstat(self._descriptor).st_size > MAX_BYTES:
            self.close()
            self._path.replace(self._path.with_name(self._path.name + ".1"))
