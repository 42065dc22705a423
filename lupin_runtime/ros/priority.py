"""Scheduling priority for processes that must respond within milliseconds while others compute."""

from __future__ import annotations

import os
from pathlib import Path

REALTIME_PRIORITY = 1  # above every ordinary process, below other real-time processes
NICE = -10


def request_realtime_scheduling() -> str:
    """Request real-time scheduling for this process, or else a better nice value; return a sentence about the result.

    Use it only for processes that sleep most of the time: on a core that a real-time process keeps busy, the kernel leaves 5 %
    to the others. Linux keeps both values per thread and passes them on to threads that are started later, so the threads that
    the middleware has already started are set one by one (sched(7)). Without permission for either, the process works as before
    but responds later under load.
    """
    threads = [int(entry.name) for entry in Path("/proc/self/task").iterdir()]
    refused = []
    for name, setter in (("real-time", _realtime), (f"nice {NICE}", _nice)):
        try:
            for thread in threads:
                setter(thread)
        except ProcessLookupError:
            return f"{name} scheduling for some of {len(threads)} threads; one exited meanwhile"
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
