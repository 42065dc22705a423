"""Detects when the battery becomes low and when it recovers, from its percentage on either scale that drivers use."""

from __future__ import annotations

import enum
import math

LOW_THRESHOLD = 0.20  # below this share the robot ends its mission and returns
SOON_THRESHOLD = 0.35  # below this share an operator is advised to charge soon


class BatteryEdge(enum.Enum):
    """A change of the battery's state."""

    LOW = "low"
    RECOVERED = "recovered"


def normalize(percentage: object) -> float | None:
    """Convert BatteryState.percentage to a fraction in [0, 1]; return None if it is not a percentage.

    Some drivers report 0..1, others 0..100, and NaN when they only know the voltage. A value above 1 is read as percent. A
    0..100 source at exactly 1 % therefore reads as full, which a single value cannot distinguish.
    """
    if isinstance(percentage, bool) or not isinstance(percentage, (int, float)):
        return None
    if not math.isfinite(percentage) or percentage < 0:
        return None
    return min(1.0, percentage / 100.0 if percentage > 1.0 else float(percentage))


class BatteryMonitor:
    """Keeps the last valid value and the low state; each edge is reported once.

    A caller that clears its own flag must read `low` again, because an edge is not repeated.
    """

    def __init__(self, threshold: float = LOW_THRESHOLD) -> None:
        if not 0.0 < threshold < 1.0:
            raise ValueError(f"battery threshold is {threshold}, expected a fraction between 0 and 1")
        self.threshold = threshold
        self.percentage = 1.0
        self.low = False

    def update(self, percentage: object) -> BatteryEdge | None:
        """Handle a BatteryState.percentage; return the edge that it caused, or None."""
        value = normalize(percentage)
        if value is None:
            return None
        self.percentage = value
        low = value < self.threshold
        if low == self.low:
            return None
        self.low = low
        return BatteryEdge.LOW if low else BatteryEdge.RECOVERED
