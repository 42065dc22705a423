"""What a console and its listener say to each other: framed sound and marks to the listener, lines of JSON back.

To the listener, each message is a kind, the length of its payload, and the payload:

* SOUND: one frame of `endpointer.py`
* BEGIN and END: a turn in speech begins or ends here; the payload is its id. A BEGIN without one: no turn is going on
* SETUP: JSON with `start_level` and `end_level` of the endpointer, and `names`: lists of those that commands may have, by kind

From the listener, each line is an object with one of these: `ready`, `missing` with a reason, `stop` with the text that was
heard outside turns or before their end, or `heard` with the `id` of a turn and its `text`. A `stop` comes with the `id` of the
turn in which it was heard; empty if it was in none, or in several. It may come when the next turn has begun.
"""

from __future__ import annotations

import enum
import struct
from typing import IO

_HEADER = struct.Struct("<cI")
MAX_PAYLOAD = 262_144


class Kind(enum.Enum):
    """What a message to the listener is."""

    SOUND = b"s"
    BEGIN = b"b"
    END = b"e"
    SETUP = b"u"


class MalformedMessage(ValueError):
    """What was read is no message to a listener."""


def encode(kind: Kind, payload: bytes) -> bytes:
    """Return a message as bytes."""
    return _HEADER.pack(kind.value, len(payload)) + payload


def read_message(stream: IO[bytes]) -> tuple[Kind, bytes] | None:
    """Read the next message; None at the end of the stream. Raises MalformedMessage."""
    header = stream.read(_HEADER.size)
    if len(header) < _HEADER.size:
        return None
    kind, length = _HEADER.unpack(header)
    if length > MAX_PAYLOAD or kind not in {each.value for each in Kind}:
        raise MalformedMessage(f"expected the header of a message, found {header!r}")
    payload = stream.read(length)
    return (Kind(kind), payload) if len(payload) == length else None
