"""Finds the processes that hold a camera, and terminates those that are drivers: a camera serves one process at a time."""

from __future__ import annotations

import contextlib
import os
import select
import signal
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

# The programs of the vendor's camera drivers. The containers among them run nothing else that holds a camera.
DRIVERS = (
    "usb_cam_node_exe",
    "astra_camera_node",
    "orbbec_camera_node",
    "component_container",
    "component_container_mt",
    "component_container_isolated",
)
_INTERPRETERS = ("python", "bash", "dash")
# Signals, each with the wait in s that follows: a driver that stops on request releases its camera cleanly.
_SIGNALS = ((signal.SIGINT, 3.0), (signal.SIGTERM, 2.0), (signal.SIGKILL, 2.0))


@dataclass(frozen=True)
class Holder:
    """A process that has a camera's device file open."""

    pid: int
    program: str
    device: str

    @property
    def is_driver(self) -> bool:
        """Whether it is one of the vendor's camera drivers."""
        return self.program in DRIVERS

    def __str__(self) -> str:
        return f"{self.program} (process {self.pid}), which has {self.device} open"


def find_holders(devices: Iterable[Path]) -> list[Holder]:
    """Return this user's processes, except this one, that hold one of the devices."""
    device_paths = {str(device) for device in devices}
    found = []
    for folder in Path("/proc").iterdir():
        if not folder.name.isdecimal() or int(folder.name) == os.getpid():
            continue
        with contextlib.suppress(OSError):  # the process has exited or belongs to another user
            targets = {str(link.readlink()) for link in (folder / "fd").iterdir()}
            held = sorted(device_paths & targets)
            program = _program(folder) if held else ""
            if program:  # else it has exited in the meantime
                found.append(Holder(int(folder.name), program, held[0]))
    return found


def terminate(holder: Holder) -> bool:
    """Ask a driver to stop, then kill it. Return False if it still runs, or if its PID now belongs to another program."""
    try:
        descriptor = os.pidfd_open(holder.pid)
    except ProcessLookupError:
        return True
    try:
        # The descriptor always refers to the same process, so it is enough to check once that its PID was not reused.
        if _program(Path(f"/proc/{holder.pid}")) != holder.program:
            return False
        for number, timeout_s in _SIGNALS:
            with contextlib.suppress(ProcessLookupError):
                signal.pidfd_send_signal(descriptor, number)
            if select.select([descriptor], [], [], timeout_s)[0]:
                return True
        return False
    finally:
        os.close(descriptor)


def _program(folder: Path) -> str:
    """Return the file name of a process's program, or of the script that its interpreter runs; empty if it cannot be read.

    The kernel's shorter `comm` is cut to 15 characters.
    """
    try:
        program = (folder / "exe").readlink().name
        words = (folder / "cmdline").read_bytes().split(b"\0")
    except OSError:
        return ""
    if program.startswith(_INTERPRETERS) and len(words) > 1 and not words[1].startswith(b"-"):
        return Path(words[1].decode(errors="replace")).name
    return program
