"""The std_msgs/Header with which a serialized message begins: when it was measured, and in which frame.

The probe counts serialized messages, because building Python objects of all of them would cost more than the rest of its work.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

_ENCAPSULATION = 4  # bytes of the CDR encapsulation header (OMG DDSI-RTPS 2.2, 10.2); its second byte is odd for little-endian


@dataclass(frozen=True)
class MessageHeader:
    """Seconds since 1970, or of simulated time, and the frame's name."""

    stamp_s: float
    frame: str


def read_header(message: bytes) -> MessageHeader | None:
    """Return the header of a serialized message whose type begins with one; None if the bytes contain no whole header."""
    order = "<" if len(message) > 1 and message[1] % 2 else ">"
    try:
        seconds, nanoseconds, length = struct.unpack_from(f"{order}iII", message, _ENCAPSULATION)
        (text,) = struct.unpack_from(f"{length}s", message, _ENCAPSULATION + 12)
    except struct.error:
        return None
    return MessageHeader(seconds + nanoseconds / 1e9, text.rstrip(b"\0").decode("utf-8", "replace"))
