"""Input events of the kernel: the codes that pads use, and a parser of `struct input_event` (linux/input.h) from any stream."""

from __future__ import annotations

import struct
from typing import NamedTuple

# Types and codes of linux/input-event-codes.h.
EV_SYN, EV_KEY, EV_ABS = 0x00, 0x01, 0x03
SYN_REPORT, SYN_DROPPED = 0, 3

BTN_SOUTH, BTN_EAST, BTN_C, BTN_NORTH, BTN_WEST, BTN_Z = 0x130, 0x131, 0x132, 0x133, 0x134, 0x135
BTN_TL, BTN_TR, BTN_TL2, BTN_TR2 = 0x136, 0x137, 0x138, 0x139

ABS_X, ABS_Y, ABS_Z, ABS_RX, ABS_RY, ABS_RZ, ABS_GAS, ABS_BRAKE = 0x00, 0x01, 0x02, 0x03, 0x04, 0x05, 0x09, 0x0A
ABS_HAT0X, ABS_HAT0Y = 0x10, 0x11

_EVENT = struct.Struct("llHHi")  # of this machine: a long is as wide as the kernel's time
EVENT_BYTES = _EVENT.size


class Event(NamedTuple):
    """An event: nanoseconds of the device's clock, and type, code and value as in linux/input.h."""

    time_ns: int
    type: int
    code: int
    value: int


def encode_event(event: Event) -> bytes:
    """Return the bytes of an event, as the kernel writes them."""
    seconds, nanoseconds = divmod(event.time_ns, 1_000_000_000)
    return _EVENT.pack(seconds, nanoseconds // 1000, event.type, event.code, event.value)


class EventParser:
    """Splits a stream into events. A device returns whole events, but a pipe may split one: its beginning is kept."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> list[Event]:
        """Return the events that `data` completes."""
        data = self._rest + data
        whole = len(data) - len(data) % EVENT_BYTES
        self._rest = data[whole:]
        return [
            Event(seconds * 1_000_000_000 + microseconds * 1000, kind, code, value)
            for seconds, microseconds, kind, code, value in _EVENT.iter_unpack(data[:whole])
        ]
