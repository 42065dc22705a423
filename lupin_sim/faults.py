"""Sensors that break on request, so that the rest can be seen to survive it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

NONE = "none"
# What may break, and how. `clock` takes seconds instead: positive jumps ahead, negative back.
FAULTS = {
    "scan": (NONE, "nan", "zero", "frozen", "silent"),
    "camera": (NONE, "silent"),
    "odometry": (NONE, "silent"),
    "board": (NONE, "silent"),  # the motor board: IMU, battery and red button
    "battery": (NONE, "nan"),  # a power watcher that can't read its chip
}
CLOCK = "clock"
LARGEST_JUMP_S = 3600.0


class UnknownFault(ValueError):
    """An order that breaks nothing; the message lists those that do."""


@dataclass
class Faults:
    """What is broken now. Orders are two words, such as `scan frozen`, `camera none` or `clock -2.5`."""

    broken: dict[str, str] = field(default_factory=lambda: dict.fromkeys(FAULTS, NONE))
    clock_offset_ns: int = 0
    _frozen: NDArray[np.float32] | None = None

    def order(self, text: str) -> None:
        """Break or mend something. Raises UnknownFault."""
        what, _, how = text.strip().partition(" ")
        if what == CLOCK:
            self._jump(how)
        elif how in FAULTS.get(what, ()):
            self.broken[what] = how
            self._frozen = None
        else:
            known = "; ".join(f"{name} {'|'.join(ways)}" for name, ways in FAULTS.items())
            raise UnknownFault(f"no fault {text!r}; there are: {known}; {CLOCK} SECONDS")

    def scan(self, ranges: NDArray[np.float32]) -> NDArray[np.float32] | None:
        """What the lidar says instead of these ranges; None says nothing."""
        how = self.broken["scan"]
        if how == "silent":
            return None
        if how == "nan":
            return np.full_like(ranges, math.nan)
        if how == "zero":
            return np.zeros_like(ranges)
        if how == "frozen":
            if self._frozen is None:
                self._frozen = ranges
            return self._frozen
        return ranges

    def silent(self, what: str) -> bool:
        """Whether a sensor says nothing."""
        return self.broken[what] == "silent"

    def _jump(self, seconds: str) -> None:
        try:
            jump_s = float(seconds)
        except ValueError:
            jump_s = math.nan
        if not abs(jump_s) <= LARGEST_JUMP_S:
            raise UnknownFault(f"the clock jumps by a number of seconds up to {LARGEST_JUMP_S:.0f}, not by {seconds!r}")
        self.clock_offset_ns += round(jump_s * 1e9)
