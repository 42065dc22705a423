"""Keeps simulated time in step with the wall clock, and measures the real-time factor."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

# A simulation that falls behind by up to CATCH_UP_S catches up at once. A larger delay is made up slowly, so that simulated
# time does not rush for the nodes that use it. At most MAX_DEBT_S are made up, so after a long halt most of the delay remains.
CATCH_UP_S = 0.3
CATCH_UP_RATE = 0.05  # seconds per second
MAX_DEBT_S = 30.0


@dataclass
class Pacer:
    """Computes the waits between steps. `speed` is simulated seconds per second of wall time; 0 is as fast as possible."""

    speed: float
    _anchor_wall_s: float = field(init=False, default=0.0)
    _anchor_sim_s: float = field(init=False, default=0.0)
    _debt_s: float = field(init=False, default=0.0)  # of wall time
    _last_call_s: float = field(init=False, default=0.0)
    _start_wall_s: float = field(init=False, default=0.0)
    _start_sim_s: float = field(init=False, default=0.0)

    def start(self, sim_s: float) -> None:
        """Start pacing at a simulated time."""
        now = time.monotonic()
        self._anchor_wall_s = self._start_wall_s = self._last_call_s = now
        self._anchor_sim_s = self._start_sim_s = sim_s

    def wait_s(self, sim_s: float) -> float:
        """Return how long to sleep before the step after the simulated time `sim_s`."""
        if self.speed <= 0.0:
            return 0.0
        now = time.monotonic()
        ahead = (sim_s - self._anchor_sim_s) / self.speed - (now - self._anchor_wall_s)
        if ahead < -CATCH_UP_S:
            self._debt_s = min(MAX_DEBT_S, self._debt_s - ahead)
            self._anchor_wall_s, self._anchor_sim_s = now, sim_s
        else:
            repaid_s = min(self._debt_s, CATCH_UP_RATE * (now - self._last_call_s))
            self._debt_s -= repaid_s
            self._anchor_wall_s -= repaid_s
            ahead -= repaid_s
        self._last_call_s = now
        return max(0.0, ahead)

    def real_time_factor(self, sim_s: float) -> float:
        """Simulated over real seconds since the start."""
        elapsed = time.monotonic() - self._start_wall_s
        return (sim_s - self._start_sim_s) / elapsed if elapsed > 0.0 else 0.0
