"""A person's own process in the place of one of a run: `lupin run PROCESS` claims the place by a lock in the run's directory.

While a place is claimed, the supervisor ends its own process, judges the place by the graph alone, and takes it back when the
claim ends, which the kernel does at the latest when the claiming process exits.
"""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

from lupin_runtime.stack.runs import Run, RunError

_OPEN = os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW


def claim_place(run: Run, process: str) -> int:
    """Claim the place of a process in a run; return a descriptor that holds the claim until it is closed.

    Raises RunError, which names the process that holds it already.
    """
    path = _path(run, process)
    path.parent.mkdir(exist_ok=True, mode=0o700)
    descriptor = os.open(path, _OPEN | os.O_CREAT, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise RunError(
            f"{process} of run {run.id} already runs in the foreground, as process {holder_of(run, process)}"
        ) from None
    os.truncate(descriptor, 0)
    os.write(descriptor, str(os.getpid()).encode())
    return descriptor


def holder_of(run: Run, process: str) -> int | None:
    """Return the PID of the process that claims a place, 0 if it is unknown; None if nobody does."""
    try:
        descriptor = os.open(_path(run, process), _OPEN)
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        text = os.read(descriptor, 20)
        return int(text) if text.isdigit() else 0
    else:
        return None
    finally:
        os.close(descriptor)


def _path(run: Run, process: str) -> Path:
    return run.path / "processes" / f"{process}.claim"
