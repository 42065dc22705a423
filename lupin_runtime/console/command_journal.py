"""The command journal: who asked the console for what, when, and whether it was allowed. One JSON object per line."""

from __future__ import annotations

import json
import os
import reprlib
import time
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

MAX_BYTES = 20_000_000
# A request that a client repeats within this time, such as a refused stream of velocities, is not written again, only counted.
_REPEAT_S = 1.0
_MAX_KEYS = 1000
_MAX_REASON = 500

# Requests may be large, and only their beginning is written: the rest is not converted to text either.
_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxdict, _SHORT.maxlist, _SHORT.maxstring, _SHORT.maxother = 6, 20, 20, 200, 200


class CommandJournal:
    """Appends to a file that only its owner may read. Beyond MAX_BYTES the file is renamed to `.1`, replacing the last one."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = self._open()
        # By request: when it was last written, and how often it was repeated since then.
        self._last: dict[tuple[str, str, str], tuple[float, int]] = {}

    def record(self, session: str, what: str, detail: Any = None, refused: str = "") -> None:
        """Write a command. A long `detail` is cut. `refused` is the reason for a refusal; empty if the command was allowed."""
        key = (session, what, refused)
        written_s, repeats = self._last.get(key, (-_REPEAT_S, 0))
        now_s = time.monotonic()
        if now_s - written_s < _REPEAT_S:
            self._last[key] = (written_s, repeats + 1)
            return
        if len(self._last) >= _MAX_KEYS:
            self._last.clear()
        self._last[key] = (now_s, 0)
        row = {"time": datetime.now(timezone.utc).isoformat(timespec="milliseconds"), "session": session, "what": what}
        if detail is not None:
            row["detail"] = _SHORT.repr(detail)
        if refused:
            row["refused"] = refused[:_MAX_REASON]
        self._write({**row, "repeats": repeats} if repeats else row)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _write(self, row: dict[str, Any]) -> None:
        self._file.write(json.dumps(row) + "\n")
        if self._file.tell() > MAX_BYTES:
            self._file.close()
            self._path.replace(self._path.with_name(self._path.name + ".1"))
            self._file = self._open()

    def _open(self) -> Any:
        descriptor = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o600)
        return os.fdopen(descriptor, "a", buffering=1, encoding="utf-8")
