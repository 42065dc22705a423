"""Input devices made of pipes, with folders like the kernel's."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from lupin_runtime.teleop.events import Event, encode_event
from lupin_runtime.teleop.pad_maps import LONG_BITS, PadId


def bitmap(numbers: Iterable[int]) -> str:
    """Return a bitmap as sysfs writes it."""
    value = sum(1 << number for number in set(numbers))
    words: list[str] = []
    while value or not words:
        words.append(f"{value % (1 << LONG_BITS):x}")
        value >>= LONG_BITS
    return " ".join(reversed(words)) + "\n"


class FakePads:
    """A folder of devices, which are pipes, and the folder of sysfs with their identities. `maps` is missing at first."""

    def __init__(self, folder: Path) -> None:
        self.devices, self.sysfs, self.maps = folder / "input", folder / "sysfs", folder / "lupin" / "pads"
        self.devices.mkdir()
        self.sysfs.mkdir()
        self._writers: dict[str, int] = {}

    def plug(self, name: str, pad: PadId, label: str = "A pad") -> None:
        """Connect a pad."""
        folder = self.sysfs / name / "device"
        values = {
            "id/bustype": f"{pad.bus:04x}\n",
            "id/vendor": f"{pad.vendor:04x}\n",
            "id/product": f"{pad.product:04x}\n",
            "id/version": f"{pad.version:04x}\n",
            "capabilities/key": bitmap(pad.keys),
            "capabilities/abs": bitmap(pad.axes),
            "name": label + "\n",
        }
        for path, text in values.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_text(text)
        os.mkfifo(self.devices / name)
        # Open for both, so that the pipe has a writer before it has a reader.
        self._writers[name] = os.open(self.devices / name, os.O_RDWR | os.O_NONBLOCK)

    def send(self, name: str, events: Iterable[Event]) -> None:
        """Write events of a pad, or bytes that are none."""
        self.send_bytes(name, b"".join(map(encode_event, events)))

    def send_bytes(self, name: str, data: bytes) -> None:
        """Write what a broken pad writes."""
        os.write(self._writers[name], data)

    def unplug(self, name: str) -> None:
        """Disconnect a pad."""
        (self.devices / name).unlink()
        os.close(self._writers.pop(name))

    def close(self) -> None:
        """Disconnect all pads."""
        for name in tuple(self._writers):
            self.unplug(name)
