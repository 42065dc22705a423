"""A JSON object in a file that several consoles of one user read and change."""

from __future__ import annotations

import fcntl
import json
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from lupin_runtime.atomic_file import MalformedFile, write_atomically
from lupin_runtime.bounded_file import open_regular
from lupin_runtime.json_text import parse_json
from lupin_runtime.stack.runs import make_state_folder

_LOCK_TIMEOUT_S = 2.0
_MAX_BYTES = 1_000_000


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Lock a file against changes by other processes, and create its folder.

    Raises OSError, and TimeoutError after _LOCK_TIMEOUT_S.
    """
    make_state_folder(path.parent)
    descriptor = os.open(path.with_suffix(".lock"), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        deadline_s = time.monotonic() + _LOCK_TIMEOUT_S
        while True:
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > deadline_s:
                    raise TimeoutError(f"another process has held the lock of {path} for {_LOCK_TIMEOUT_S:g} s") from None
                time.sleep(0.01)
        yield
    finally:
        os.close(descriptor)


def read_object(path: Path) -> dict[str, Any]:
    """Return the object in a file; an empty one if there is no file. Raises MalformedFile and OSError."""
    try:
        with open_regular(path) as file:
            content = file.read(_MAX_BYTES + 1)
        if len(content) > _MAX_BYTES:
            raise ValueError(f"more than {_MAX_BYTES} bytes")
        value = parse_json(content)
        if not isinstance(value, dict):
            raise ValueError("expected a JSON object")
    except FileNotFoundError:
        return {}
    except ValueError as error:
        raise MalformedFile(path, None, f"{error}; move it away to start with an empty one") from error
    return value


def change_object(path: Path, change: Callable[[dict[str, Any]], dict[str, Any]]) -> dict[str, Any]:
    """Replace the object in a file with the result of `change`, and return it.

    Raises MalformedFile and OSError, and whatever `change` raises.
    """
    with locked(path):
        changed = change(read_object(path))
        write_atomically(path, json.dumps(changed, indent=1, allow_nan=False) + "\n", mode=0o600, sync=True)
    return changed
