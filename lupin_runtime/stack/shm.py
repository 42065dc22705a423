"""A full /dev/shm must not take the stack down.

DDS uses none of it here (`dds.py`), but the tracing library that comes with the ROS wheels maps a page of it when it is loaded,
and a process that touches a page for which there is no room dies of SIGBUS.
"""

from __future__ import annotations

import os
from pathlib import Path

_PAGE_BYTES = 4096
# liblttng-ust 2.8's meeting points, for the system's and for the user's tracer (lttng-ust, ust-wait-shm).
_NAMES = ("lttng-ust-wait-6", "lttng-ust-wait-6-{uid}")


def spare_the_tracer(folder: Path = Path("/dev/shm")) -> list[Path]:
    """Where there is no room for the tracer's pages, make it do without: a directory of that name cannot be mapped.

    Returns what was made, to be removed when this process ends. Does nothing where the pages exist or fit.
    """
    free = os.statvfs(folder)
    if free.f_bavail * free.f_frsize >= 16 * _PAGE_BYTES:
        return []
    made = []
    for name in _NAMES:
        path = folder / name.format(uid=os.getuid())
        if path.is_file() and path.stat().st_blocks == 0:
            path.unlink()  # a file without its page: whoever made it died of that
        if not path.exists():
            path.mkdir()
            made.append(path)
    return made
