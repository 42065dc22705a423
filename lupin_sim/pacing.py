"""Keeping simulated time in step with the wall clock, and measuring how well that goes."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

# How far the simulation may fall behind and still catch up at once. What is lost beyond it is made up slowly, so that nobody
# who lives in simulated time is rushed; after a long halt most of it stays lost.
CATCH_UP_S = 0.3
HURRY = 0.05  # seconds a second
MOST_OWED_S = 30.0


@dataclass
class Pacer:
    """`speed` is simulated seconds per second of wall time; 0 runs as fast as it goes."""

    speed: float
    _anchor_wall_s: float = field(init=False, default=0.0)
    _anchor_sim_s: float = field(init=False, default=0.0)
    _owed_s: float = field(init=False, default=0.0)  # of wall time
    _asked_s: float = field(init=False, default=0.0)
    _start_wall_s: float = field(init=False, default=0.0)
    _start_sim_s: float = field(init=False, default=0.0)

    def start(self, sim_s: float) -> None:
        """Begin at a simulated time."""
        now = time.monotonic()
        self._anchor_wall_s = self._start_wall_s = self._asked_s = now
        self._anchor_sim_s = self._start_sim_s = sim_s

    def wait_s(self, sim_s: float) -> float:
        """How long to sleep before simulated time may go on from here."""
        if self.speed <= 0.0:
            return 0.0
        now = time.monotonic()
        ahead = (sim_s - self._anchor_sim_s) / self.speed - (now - self._anchor_wall_s)
        if ahead < -CATCH_UP_S:
            self._owed_s = min(MOST_OWED_S, self._owed_s - ahead)
            self._anchor_wall_s, self._anchor_sim_s = now, sim_s
        else:
            repaid_s = min(self._owed_s, HURRY * (now - self._asked_s))
            self._owed_s -= repaid_s
            self._anchor_wall_s -= repaid_s
            ahead -= repaid_s
        self._asked_s = now
        return max(0.0, ahead)

    def real_time_factor(self, sim_s: float) -> float:
        """Simulated over real seconds since the start."""
        elapsed = time.monotonic() - self._start_wall_s
        return (sim_s - self._start_sim_s) / elapsed if elapsed > 0.0 else 0.0
