"""Turns a battery's percentage into one low and one recovered edge, whatever scale its driver uses."""

from __future__ import annotations

import enum
import math

LOW_THRESHOLD = 0.20


class BatteryEdge(enum.Enum):
    """What just changed."""

    LOW = "low"
    RECOVERED = "recovered"


def normalise(percentage: object) -> float | None:
    """The fraction in [0, 1] that a BatteryState.percentage means, or None where it means nothing.

    Some drivers report 0..1, others 0..100, and NaN when they only know the voltage. Above 1 it is read as percent; so a
    0..100 source at exactly 1 % reads as full, which no rule over a single value can tell apart.
    """
    if isinstance(percentage, bool) or not isinstance(percentage, (int, float)):
        return None
    if not math.isfinite(percentage) or percentage < 0:
        return None
    return min(1.0, percentage / 100.0 if percentage > 1.0 else float(percentage))


class BatteryMonitor:
    """Keeps the last good value and latches the low state; each edge is reported once.

    `low` is the state itself: whoever keeps a flag of its own and clears it must read this again, for the edge does not
    come twice.
    """

    def __init__(self, threshold: float = LOW_THRESHOLD) -> None:
        if not 0.0 < threshold < 1.0:
            raise ValueError(f"battery threshold is {threshold}, expected a fraction between 0 and 1")
        self.threshold = threshold
        self.percentage = 1.0
        self.low = False

    def update(self, percentage: object) -> BatteryEdge | None:
        """Take a BatteryState.percentage; returns the edge that it brought, if any."""
        value = normalise(percentage)
        if value is None:
            return None
        self.percentage = value
        low = value < self.threshold
        if low == self.low:
            return None
        self.low = low
        return BatteryEdge.LOW if low else BatteryEdge.RECOVERED
