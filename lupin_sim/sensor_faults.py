"""Sensor faults on request, for tests of how the runtime reacts to them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

NONE = "none"
# Sensors and their modes. `clock` takes a jump in seconds instead: positive is forward, negative backward.
FAULTS = {
    "scan": (NONE, "nan", "zero", "frozen", "silent"),
    "camera": (NONE, "silent"),
    "odometry": (NONE, "silent"),
    "board": (NONE, "silent"),  # the motor board: IMU, battery and e-stop button
    "battery": (NONE, "nan"),  # a power monitor that cannot read its chip
}
CLOCK = "clock"
MAX_JUMP_S = 3600.0


class UnknownFault(ValueError):
    """A request for an unknown fault; the message lists the known ones."""


@dataclass
class SensorFaults:
    """The active sensor faults. A request is two words, such as `scan frozen`, `camera none` or `clock -2.5`."""

    modes: dict[str, str] = field(default_factory=lambda: dict.fromkeys(FAULTS, NONE))
    clock_offset_ns: int = 0
    _frozen: NDArray[np.float32] | None = None

    def apply(self, text: str) -> None:
        """Set the mode of a sensor, or let the clock jump. Raises UnknownFault."""
        sensor, _, mode = text.strip().partition(" ")
        if sensor == CLOCK:
            self._jump(mode)
        elif mode in FAULTS.get(sensor, ()):
            self.modes[sensor] = mode
            self._frozen = None
        else:
            known = "; ".join(f"{name} {'|'.join(modes)}" for name, modes in FAULTS.items())
            raise UnknownFault(f"there is no fault {text!r}; there are: {known}; {CLOCK} SECONDS")

    def scan(self, ranges: NDArray[np.float32]) -> NDArray[np.float32] | None:
        """The ranges that the lidar reports instead of these; None if it reports nothing."""
        mode = self.modes["scan"]
        if mode == "silent":
            return None
        if mode == "nan":
            return np.full_like(ranges, math.nan)
        if mode == "zero":
            return np.zeros_like(ranges)
        if mode == "frozen":
            if self._frozen is None:
                self._frozen = ranges
            return self._frozen
        return ranges

    def silent(self, sensor: str) -> bool:
        """Whether a sensor reports nothing."""
        return self.modes[sensor] == "silent"

    def _jump(self, seconds: str) -> None:
        try:
            jump_s = float(seconds)
        except ValueError:
            jump_s = math.nan
        if not abs(jump_s) <= MAX_JUMP_S:
            raise UnknownFault(f"expected a clock jump of at most {MAX_JUMP_S:.0f} s, found {seconds!r}")
        self.clock_offset_ns += round(jump_s * 1e9)
