"""Zero offsets of the arm's servos from a pose that an operator set by hand.

The operator holds the arm where every joint's angle is to be zero; what the encoders then read, beside the counts that a
well-built arm reads there, is the offset. The pan joint is left out on purpose: nothing shows by eye where its zero is.
All numbers are encoder counts; the vendor's offset field is named centidegrees and carries counts all the same.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from statistics import median_low
from typing import NamedTuple

HOME_COUNTS = {"shoulder_lift": 11450, "elbow": 11750, "wrist": 12200, "gripper": 10524}

SMALLEST_COUNTS = 200
# An arm that is off by more was put together a tooth off: an offset would hide that, and run out of range elsewhere.
LARGEST_COUNTS = 3000


class State(enum.Enum):
    """Where a calibration stands."""

    IDLE = "IDLE"
    AWAITING_POSE = "AWAITING_POSE"


class Finding(NamedTuple):
    """Of one servo: how far it reads from home, the offset to write (None: leave it), and what to tell the operator."""

    diff: int
    offset: int | None
    remark: str


def find(servo: str, raw: Sequence[int], current_offset: int) -> Finding:
    """What a servo's readings in the operator's pose say. Raises ValueError where there are none."""
    if not raw:
        raise ValueError(f"{servo}: no encoder readings arrived")
    diff = median_low(raw) - HOME_COUNTS[servo]
    total = diff + current_offset
    if abs(total) <= SMALLEST_COUNTS:
        return Finding(diff, None, f"{servo}: within {SMALLEST_COUNTS} counts, left as it is")
    if abs(total) > LARGEST_COUNTS:
        return Finding(diff, None, f"{servo}: {total} counts off, so it is assembled wrongly; nothing written")
    return Finding(diff, total, f"{servo}: offset {total}")
