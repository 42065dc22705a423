"""A process that must answer within milliseconds asks the scheduler to be served before those that compute."""

from __future__ import annotations

import os
from pathlib import Path

REALTIME_PRIORITY = 1  # above every ordinary process, below whatever else on the machine is real-time
NICE = -10


def serve_first() -> str:
    """Ask for real-time scheduling of this process, else for a better nice value; returns what came of it, in words.

    Only for processes that sleep nearly always: the kernel leaves others 5 % of a core that a real-time process spins on.
    Linux keeps both values per thread and hands them to threads started later, so those that the middleware already
    started are set one by one (sched(7)). Without the right to either nothing changes: all works, only less promptly under
    load.
    """
    threads = [int(entry.name) for entry in Path("/proc/self/task").iterdir()]
    refused = []
    for name, setter in (("real-time", _realtime), (f"nice {NICE}", _nice)):
        try:
            for thread in threads:
                setter(thread)
        except ProcessLookupError:
            return f"{name} scheduling for some of {len(threads)} threads: one ended meanwhile"
        except PermissionError as error:
            refused.append(f"{name}: {error}")
        else:
            return f"{name} scheduling for {len(threads)} threads"
    return (
        f"ordinary scheduling ({'; '.join(refused)}); allow more with "
        f"LimitRTPRIO={REALTIME_PRIORITY} and LimitNICE={NICE} in the unit file"
    )


def _realtime(thread: int) -> None:
    os.sched_setscheduler(thread, os.SCHED_RR, os.sched_param(REALTIME_PRIORITY))


def _nice(thread: int) -> None:
    os.setpriority(os.PRIO_PROCESS, thread, NICE)
