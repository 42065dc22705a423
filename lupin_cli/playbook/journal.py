"""The journal: one file of JSON lines per playbook run. What resume and undo need is on disk before the run goes on.

The files are below $XDG_STATE_HOME/lupin/journal/ and readable by their owner only, since `before`, which undo needs, is
not masked; everything else is. A run locks its file. A file that has no `end` line and is not locked belongs to a run that was
cut off; it can be resumed.
"""

from __future__ import annotations

import base64
import contextlib
import fcntl
import functools
import json
import os
import re
import shlex
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from lupin_cli.secret_masking import MASK, mask_secrets
from lupin_runtime.bounded_file import open_regular
from lupin_runtime.json_text import parse_json
from lupin_runtime.stack.runs import make_state_folder, state_directory

_MIN_SECRET_LENGTH = 3
MAX_JOURNALS = 500


class JournalError(Exception):
    """A journal cannot be read or written, or its run cannot be resumed or undone. `next_command` is what to type next."""

    def __init__(self, message: str, next_command: str = "") -> None:
        super().__init__(message)
        self.next_command = next_command


def journal_folder() -> Path:
    """Return the folder of the journals."""
    return state_directory() / "journal"


@dataclass(frozen=True)
class Mask:
    """Replaces secrets in what is written: the values of secret variables, and `psk=...` and the like in any output."""

    secrets: tuple[str, ...] = ()

    @functools.cached_property
    def _forms(self) -> tuple[str, ...]:
        """The secrets as a text may show them, the longest first: plain, in the quotes of a shell, JSON or Python, by line."""
        forms = set()
        for secret in self.secrets:
            for part in (secret, *secret.splitlines()):
                if len(part) >= _MIN_SECRET_LENGTH:
                    quoted = (shlex.quote(part).strip("'"), json.dumps(part)[1:-1], json.dumps(part, ensure_ascii=False)[1:-1])
                    forms |= {part, *quoted, repr(part)[1:-1], base64.b64encode(part.encode()).decode()}
        return tuple(sorted(forms, key=lambda form: (-len(form), form)))

    def __call__(self, value: Any) -> Any:
        """Return a JSON value with every secret in its strings replaced."""
        if isinstance(value, str):
            for form in self._forms:
                value = value.replace(form, MASK)
            return mask_secrets(value)
        if isinstance(value, Mapping):
            return {key: self(item) for key, item in value.items()}
        if isinstance(value, (list, tuple)):
            return [self(item) for item in value]
        return value


def remove_old_journals(folder: Path, newest: int = MAX_JOURNALS) -> list[Path]:
    """Remove the journals of completed playbook runs except the `newest`, but none that can be resumed. Returns their paths."""
    removed = []
    for path in sorted(folder.glob("*.jsonl"))[:-newest]:
        try:
            with open_regular(path) as file:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                last = parse_json(file.read().rstrip().rpartition(b"\n")[2])
            if isinstance(last, dict) and last.get("event") == "end" and (last.get("state") == "done" or last.get("closed")):
                path.unlink()
                removed.append(path)
        except (OSError, ValueError):
            continue  # it is in use, damaged, or may not be removed
    return removed


class Journal:
    """The open, locked journal of one run."""

    def __init__(self, path: Path, descriptor: int, mask: Mask) -> None:
        self.path = path
        self.run = path.stem
        self._descriptor = descriptor
        self._mask = mask
        self._lock = threading.Lock()

    @classmethod
    def begin(cls, folder: Path, playbook: str, robot: str, mask: Mask, start: Mapping[str, Any]) -> Journal:
        """Create the journal of a new run and write its `start`; raises JournalError."""
        stamp = datetime.now(timezone.utc).strftime("%Y%m%d-%H%M%S")
        stem = re.sub(r"[^A-Za-z0-9_.-]+", "-", f"{stamp}-{playbook}" + (f"-{robot}" if robot else ""))
        try:
            make_state_folder(folder)
            for count in range(1000):
                path = folder / (f"{stem}.jsonl" if count == 0 else f"{stem}.{count}.jsonl")
                try:
                    descriptor = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
                    break
                except FileExistsError:
                    continue
            else:
                raise JournalError(f"{folder} has a thousand journals of the same second")
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            directory = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
            os.fsync(directory)
            os.close(directory)
        except OSError as error:
            raise JournalError(
                f"the journal cannot be written in {folder}: {error.strerror or error}", "export XDG_STATE_HOME=..."
            ) from error
        journal = cls(path, descriptor, mask)
        journal.write("start", **start)
        remove_old_journals(folder)
        return journal

    @classmethod
    def reopen(cls, path: Path, mask: Mask) -> Journal:
        """Open the journal of a run that was cut off, to resume it; raises JournalError if the run is still going on."""
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CLOEXEC)
        except OSError as error:
            raise JournalError(f"{path} cannot be written: {error.strerror or error}") from error
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(descriptor)
            raise JournalError(f"the run {path.stem} is still going on", f"lupin journal show {path.stem}") from error
        journal = cls(path, descriptor, mask)
        size = os.fstat(descriptor).st_size
        if size and os.pread(descriptor, 1, size - 1) != b"\n":
            os.write(descriptor, b"\n")  # the incomplete last line stays unreadable; the next one is complete
        journal.write("resume")
        return journal

    def write(self, event: str, *, sync: bool = True, before: Mapping[str, Any] | None = None, **values: Any) -> None:
        """Add one line, all of it or nothing, and, with `sync`, wait until it is on disk. Raises JournalError.

        `before` is not masked, since undo needs it as it was.
        """
        line = {"event": event, "time": datetime.now(timezone.utc).isoformat(timespec="milliseconds"), **self._mask(values)}
        if before is not None:
            line["before"] = dict(before)
        data = json.dumps(line, ensure_ascii=False).encode("utf-8", "surrogateescape") + b"\n"
        with self._lock:
            size = os.fstat(self._descriptor).st_size
            try:
                while data:
                    data = data[os.write(self._descriptor, data) :]
                if sync:
                    os.fdatasync(self._descriptor)
            except OSError as error:
                with contextlib.suppress(OSError):
                    os.ftruncate(self._descriptor, size)  # the disk is full: the start of this line would spoil the next one
                raise JournalError(f"{self.path} cannot be written: {error.strerror or error}", "lupin journal list") from error

    def close(self) -> None:
        """Close the file and release its lock."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1
