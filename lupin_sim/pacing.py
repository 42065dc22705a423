"""Keeping simulated time in step with the wall clock, and measuring how well that goes."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

# How far the simulation may fall behind and still catch up by hurrying; beyond it the lost time stays lost.
CATCH_UP_S = 0.3


@dataclass
class Pacer:
    """`speed` is simulated seconds per second of wall time; 0 runs as fast as it goes."""

    speed: float
    _anchor_wall_s: float = field(init=False, default=0.0)
    _anchor_sim_s: float = field(init=False, default=0.0)
    _start_wall_s: float = field(init=False, default=0.0)
    _start_sim_s: float = field(init=False, default=0.0)

    def start(self, sim_s: float) -> None:
        """Begin at a simulated time."""
        now = time.monotonic()
        self._anchor_wall_s = self._start_wall_s = now
        self._anchor_sim_s = self._start_sim_s = sim_s

    def wait_s(self, sim_s: float) -> float:
        """How long to sleep before simulated time may go on from here."""
        if self.speed <= 0.0:
            return 0.0
        now = time.monotonic()
        ahead = (sim_s - self._anchor_sim_s) / self.speed - (now - self._anchor_wall_s)
        if ahead < -CATCH_UP_S:
            self._anchor_wall_s, self._anchor_sim_s = now, sim_s
        return max(0.0, ahead)

    def real_time_factor(self, sim_s: float) -> float:
        """Simulated over real seconds since the start."""
        elapsed = time.monotonic() - self._start_wall_s
        return (sim_s - self._start_sim_s) / elapsed if elapsed > 0.0 else 0.0
