"""Keeps the stack running when /dev/shm is full.

DDS does not use shared memory here (see `dds.py`), but lttng-ust, which comes with the ROS wheels, maps a page of /dev/shm when
it is loaded. A process that touches a mapped page for which there is no space is killed by SIGBUS.
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

_PAGE_BYTES = 4096
# The wait files of liblttng-ust 2.8, for the system's and the user's session daemon (lttng-ust, ust-wait-shm).
_NAMES = ("lttng-ust-wait-6", "lttng-ust-wait-6-{uid}")


def disable_lttng_shm(folder: Path = Path("/dev/shm")) -> list[Path]:  # noqa: S108 -- LTTng's own folder
    """If /dev/shm is full, create directories in place of lttng-ust's wait files, so that it cannot map them.

    Return the created directories, which are removed after this process has exited. Do nothing if there is space.
    """
    free = os.statvfs(folder)
    if free.f_bavail * free.f_frsize >= 16 * _PAGE_BYTES:
        return []
    made = []
    for name in _NAMES:
        path = folder / name.format(uid=os.getuid())
        if path.is_file() and path.stat().st_blocks == 0:
            path.unlink()  # a file without its page, left by a process that SIGBUS killed
        if not path.exists():
            path.mkdir()
            made.append(path)
    _remove_after_exit(made)
    return made


def _remove_after_exit(folders: list[Path]) -> None:
    """Let a shell remove empty folders after this process has exited.

    The tracer's threads try to map the files as long as this process lives, even while the interpreter shuts down.
    """
    if not folders:
        return
    reading, _open_until_exit = os.pipe()
    subprocess.Popen(
        ["/bin/sh", "-c", 'read -r _; rmdir "$@"', "sh", *map(str, folders)],
        stdin=reading,
        start_new_session=True,  # an interrupt from the terminal must not terminate it early
    )
    os.close(reading)
