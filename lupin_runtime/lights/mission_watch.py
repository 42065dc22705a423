"""Tells a mission whose laptop vanished from one that ended."""

from __future__ import annotations

from dataclasses import replace

from lupin_runtime.lights.palette import IN_PROGRESS_COLORS
from lupin_runtime.lights.precedence import Mission


class MissionWatch:
    """Follows the mission's states, which are fresh for `timeout_s`. Times are nanoseconds of one clock.

    With `forgets`, a state that is not fresh is none: a robot stops by its own e-stop, and works on after a mission has ended
    with a fault.
    """

    def __init__(self, timeout_s: float, forgets: bool = False) -> None:
        self._timeout_ns, self._forgets = int(timeout_s * 1e9), forgets
        self._mission: tuple[Mission, int] | None = None
        self._was_fresh = False
        self.lost = False  # whether a mission in progress fell silent, and nothing has been heard of it since

    def handle(self, mission: Mission, now_ns: int) -> None:
        """Handle a state."""
        self._mission, self._was_fresh, self.lost = (mission, now_ns), True, False

    def view(self, now_ns: int, publishers: int) -> Mission | None:
        """Return the last state, with its freshness; None before the first, or if it is forgotten.

        `publishers` of the state are on the graph now. A program that ends takes its publisher away at once, while that of a
        computer that vanished stays until its lease expires, which takes longer than the timeout.
        """
        if self._mission is None:
            return None
        mission, received_ns = self._mission
        fresh = 0 <= now_ns - received_ns <= self._timeout_ns
        if self._was_fresh and not fresh:
            self.lost = publishers > 0 and mission.lifecycle in IN_PROGRESS_COLORS
        self._was_fresh = fresh
        return None if self._forgets and not fresh else replace(mission, fresh=fresh)
