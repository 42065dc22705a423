"""A process that must answer within milliseconds asks the scheduler to be served before those that compute."""

from __future__ import annotations

import os
from pathlib import Path


def raise_priority(nice: int) -> str:
    """Set `nice` (negative is sooner) on every thread of this process; returns a sentence about what came of it.

    Linux keeps the value per thread and gives it to threads started later, so those that the middleware already started
    are set one by one. Without the right to do so nothing changes: the bus works, only less promptly under load.
    """
    threads = [int(entry.name) for entry in Path("/proc/self/task").iterdir()]
    try:
        for thread in threads:
            os.setpriority(os.PRIO_PROCESS, thread, nice)
    except (PermissionError, ProcessLookupError) as error:
        return f"scheduling priority unchanged ({error}); allow it with LimitNICE={nice} in the unit file"
    return f"scheduling priority {nice} for {len(threads)} threads"
