"""Processes that hold a camera, and the end of those that are drivers: a camera serves one process at a time."""

from __future__ import annotations

import contextlib
import os
import select
import signal
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

# The programs of the vendor's camera drivers; their containers run nothing else that holds a camera.
DRIVERS = (
    "usb_cam_node_exe",
    "astra_camera_node",
    "orbbec_camera_node",
    "component_container",
    "component_container_mt",
    "component_container_isolated",
)
_INTERPRETERS = ("python", "bash", "dash")
# A driver that is asked to stop releases its camera cleanly; one that does not is killed.
_ENDING = ((signal.SIGINT, 3.0), (signal.SIGTERM, 2.0), (signal.SIGKILL, 2.0))


@dataclass(frozen=True)
class Holder:
    """A process that has a camera's device file open."""

    pid: int
    program: str
    device: str

    @property
    def is_driver(self) -> bool:
        """Whether it is a camera driver of the vendor's."""
        return self.program in DRIVERS

    def __str__(self) -> str:
        return f"{self.program} (process {self.pid}), which has {self.device} open"


def find_holders(devices: Iterable[Path]) -> list[Holder]:
    """The processes of this user that hold one of the devices, without this process."""
    wanted = {str(device) for device in devices}
    found = []
    for folder in Path("/proc").iterdir():
        if not folder.name.isdecimal() or int(folder.name) == os.getpid():
            continue
        with contextlib.suppress(OSError):  # it has ended, or is another user's
            targets = {str(link.readlink()) for link in (folder / "fd").iterdir()}
            held = sorted(wanted & targets)
            program = _program(folder) if held else ""
            if program:  # else it has ended since
                found.append(Holder(int(folder.name), program, held[0]))
    return found


def end(holder: Holder) -> bool:
    """End a driver: ask it to stop, then kill it. False where it is still there, or no longer the process that was found."""
    try:
        descriptor = os.pidfd_open(holder.pid)
    except ProcessLookupError:
        return True
    try:
        # The descriptor is of one process for good: this is the one that was found, or its number has been given away.
        if _program(Path(f"/proc/{holder.pid}")) != holder.program:
            return False
        for number, timeout_s in _ENDING:
            with contextlib.suppress(ProcessLookupError):
                signal.pidfd_send_signal(descriptor, number)
            if select.select([descriptor], [], [], timeout_s)[0]:
                return True
        return False
    finally:
        os.close(descriptor)


def _program(folder: Path) -> str:
    """The file name of the program, or of the script that an interpreter runs; `comm` would be cut to 15 characters."""
    try:
        program = (folder / "exe").readlink().name
        words = (folder / "cmdline").read_bytes().split(b"\0")
    except OSError:
        return ""
    if program.startswith(_INTERPRETERS) and len(words) > 1 and not words[1].startswith(b"-"):
        return Path(words[1].decode(errors="replace")).name
    return program
