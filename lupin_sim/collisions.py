"""Counts the robot's collisions; a contact counts once, however long it lasts."""

from __future__ import annotations

import math

DEBOUNCE_S = 1.0


class CollisionCounter:
    """Counts collisions. A contact is a new collision if there was none for DEBOUNCE_S before."""

    def __init__(self) -> None:
        self.count = 0
        self.last_object: str | None = None
        self.last_time_s: float | None = None
        self._last_contact_s = -math.inf

    def update(self, touched: str | None, time_s: float) -> bool:
        """Take the name of the object that the robot touches now (None: no contact); True if this is a new collision."""
        if touched is None:
            return False
        is_new = time_s - self._last_contact_s > DEBOUNCE_S
        self._last_contact_s = time_s
        if is_new:
            self.count += 1
            self.last_object, self.last_time_s = touched, time_s
        return is_new
