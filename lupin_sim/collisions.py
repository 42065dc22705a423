"""Counting what the robot bumps into: one episode a touch, however long it rubs."""

from __future__ import annotations

import math

DEBOUNCE_S = 1.0


class CollisionCounter:
    """A new episode begins when nothing was touched for a second before."""

    def __init__(self) -> None:
        self.count = 0
        self.last_what: str | None = None
        self.last_time_s: float | None = None
        self._touched_s = -math.inf

    def update(self, touched: str | None, time_s: float) -> bool:
        """Take what is touched now (None: nothing); True when that starts an episode."""
        if touched is None:
            return False
        fresh = time_s - self._touched_s > DEBOUNCE_S
        self._touched_s = time_s
        if fresh:
            self.count += 1
            self.last_what, self.last_time_s = touched, time_s
        return fresh
