"""One input device of the kernel (evdev): its identity from sysfs, its events, and the state that the kernel keeps of it.

Where the file is not a device, as a pipe in a test, the kernel cannot be asked: ranges come from the table of pads, and the
state from events alone.
"""

from __future__ import annotations

import array
import errno
import fcntl
import os
import struct
import time
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from lupin_runtime.teleop.events import EVENT_BYTES, Event, EventParser
from lupin_runtime.teleop.pad_maps import PadId, parse_bits
from lupin_runtime.teleop.pad_state import MAX_EVENTS, Snapshot

_KEY_BYTES = 0x300 // 8  # KEY_CNT
_ABSINFO = struct.Struct("6i")  # struct input_absinfo: value, minimum, maximum, fuzz, flat, resolution
# The requests of linux/input.h: direction and size of the argument, the letter E, and a number.
_SET_CLOCK = 0x4004_45A0
_GET_KEYS = 0x8000_4518 | _KEY_BYTES << 16
_GET_AXIS = 0x8000_4540 | _ABSINFO.size << 16


def read_identity(folder: Path) -> PadId:
    """Return the identity of a device from its folder in sysfs, such as /sys/class/input/event7/device.

    Raises OSError if it is gone, and ValueError for a file that is not what sysfs has.
    """

    def text(name: str) -> str:
        return (folder / name).read_text(encoding="ascii")

    bus, vendor, product, version = (int(text(f"id/{name}"), 16) for name in ("bustype", "vendor", "product", "version"))
    keys, axes = (parse_bits(text(f"capabilities/{name}")) for name in ("key", "abs"))
    return PadId(bus, vendor, product, version, keys, axes)


def read_name(folder: Path) -> str:
    """Return the name of a device from its folder in sysfs; empty if it has none."""
    with suppress(OSError):
        return (folder / "name").read_text(encoding="utf-8", errors="replace").strip()
    return ""


class Device:
    """An open device, which never blocks. All methods but `close` raise OSError once it has been unplugged."""

    def __init__(self, path: Path) -> None:
        """Open a device. Raises OSError, which is a PermissionError if this user may not read it."""
        self.file = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        self._parser = EventParser()
        with suppress(OSError):  # not a device
            fcntl.ioctl(self.file, _SET_CLOCK, array.array("i", [time.CLOCK_MONOTONIC]))

    def claim(self) -> bool:
        """Keep other programs of Lupin from driving by this device until it is closed; return whether none does already."""
        try:
            fcntl.flock(self.file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return False
        return True

    def close(self) -> None:
        """Close the file."""
        os.close(self.file)

    def read(self) -> list[Event]:
        """Return the waiting events, at most one more than a pad sends at a time. Raises OSError also at the end of a pipe."""
        try:
            data = os.read(self.file, (MAX_EVENTS + 1) * EVENT_BYTES)
        except BlockingIOError:
            return []
        if not data:
            raise OSError(errno.EPIPE, "the pipe has no writer")
        return self._parser.feed(data)

    def ranges(self, axes: Iterable[int]) -> dict[int, tuple[int, int]]:
        """Return lowest and highest value of the axes; empty if this is not a device."""
        found = ((code, self._axis(code)) for code in axes)
        return {code: (info[1], info[2]) for code, info in found if info is not None}

    def snapshot(self, axes: Iterable[int]) -> Snapshot | None:
        """Return the pressed keys and the values of the axes; None if this is not a device."""
        pressed = bytearray(_KEY_BYTES)
        try:
            fcntl.ioctl(self.file, _GET_KEYS, pressed)
        except OSError:
            return None
        values = ((code, self._axis(code)) for code in axes)
        keys = frozenset(code for code in range(8 * _KEY_BYTES) if pressed[code // 8] >> code % 8 & 1)
        return Snapshot(keys, {code: info[0] for code, info in values if info is not None})

    def _axis(self, code: int) -> tuple[int, ...] | None:
        info = bytearray(_ABSINFO.size)
        try:
            fcntl.ioctl(self.file, _GET_AXIS + code, info)
        except OSError:
            return None
        return _ABSINFO.unpack(info)
