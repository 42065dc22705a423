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


class InvalidFault(ValueError):
    """An invalid request for a fault; the message says what was expected and what was found."""


@dataclass
class SensorFaults:
    """The active sensor faults. A request is two words, such as `scan frozen`, `camera none` or `clock -2.5`."""

    modes: dict[str, str] = field(default_factory=lambda: dict.fromkeys(FAULTS, NONE))
    clock_offset_ns: int = 0
    _frozen_ranges: NDArray[np.float32] | None = None

    def apply(self, text: str) -> None:
        """Set the mode of a sensor, or let the clock jump. Raises InvalidFault."""
        sensor, _, mode = text.strip().partition(" ")
        if sensor == CLOCK:
            self._jump(mode)
        elif mode in FAULTS.get(sensor, ()):
            self.modes[sensor] = mode
            self._frozen_ranges = None
        else:
            known = "; ".join(f"{name} {'|'.join(modes)}" for name, modes in FAULTS.items())
            raise InvalidFault(f"unknown sensor fault {text!r}; expected one of: {known}; {CLOCK} SECONDS")

    def distort_scan(self, ranges: NDArray[np.float32]) -> NDArray[np.float32] | None:
        """Return the ranges (m) with the active fault of the lidar applied, or None if it is silent."""
        mode = self.modes["scan"]
        if mode == "silent":
            return None
        if mode == "nan":
            return np.full_like(ranges, math.nan)
        if mode == "zero":
            return np.zeros_like(ranges)
        if mode == "frozen":
            if self._frozen_ranges is None:
                self._frozen_ranges = ranges
            return self._frozen_ranges
        return ranges

    def is_silent(self, sensor: str) -> bool:
        """Return whether a sensor reports nothing."""
        return self.modes[sensor] == "silent"

    def _jump(self, seconds: str) -> None:
        try:
            jump_s = float(seconds)
        except ValueError:
            jump_s = math.nan
        if not abs(jump_s) <= MAX_JUMP_S:
            raise InvalidFault(
                f"expected a clock jump in seconds, at most {MAX_JUMP_S:.0f} in either direction, found {seconds!r}"
            )
        self.clock_offset_ns += round(jump_s * 1e9)
