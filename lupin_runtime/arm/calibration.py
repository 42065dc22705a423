"""Zero offsets of the arm's servos from a pose that an operator sets by hand.

The operator holds the arm so that every joint's angle should be zero. The offset is the difference between the readings of the
encoders and those of a correctly assembled arm. The pan joint is excluded, because its zero cannot be seen by eye. All numbers
are encoder counts; the vendor's offset field is named centidegrees but carries counts.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from statistics import median_low
from typing import NamedTuple

HOME_COUNTS = {"shoulder_lift": 11450, "elbow": 11750, "wrist": 12200, "gripper": 10524}

MIN_COUNTS = 200
# A larger difference means that a servo horn was mounted a tooth off. An offset would hide that and exceed the range elsewhere.
MAX_COUNTS = 3000


class State(enum.Enum):
    """The state of a calibration."""

    IDLE = "IDLE"
    AWAITING_POSE = "AWAITING_POSE"


class ServoOffset(NamedTuple):
    """A servo's difference from its home reading, the offset to write (None: keep it), and a remark for the operator."""

    diff: int
    offset: int | None
    remark: str


def find_offset(servo: str, raw: Sequence[int], current_offset: int) -> ServoOffset:
    """Compute the offset of a servo from its readings in the operator's pose. Raises ValueError without readings."""
    if not raw:
        raise ValueError(f"{servo}: no encoder readings arrived")
    diff = median_low(raw) - HOME_COUNTS[servo]
    total = diff + current_offset
    if abs(total) <= MIN_COUNTS:
        return ServoOffset(diff, None, f"{servo}: within {MIN_COUNTS} counts, unchanged")
    if abs(total) > MAX_COUNTS:
        return ServoOffset(diff, None, f"{servo}: {total} counts off, so it is assembled wrongly; no offset was written")
    return ServoOffset(diff, total, f"{servo}: offset {total}")
