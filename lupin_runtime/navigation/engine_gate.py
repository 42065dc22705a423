"""When velocities of an engine that knows nothing of the e-stop may pass."""

from __future__ import annotations

from collections.abc import Iterable

from lupin_runtime.safety.estop_monitor import DRAIN_S


class EngineGate:
    """Closed until everything in `needed` is known, while the e-stop is engaged, and after it until every older goal has ended.

    While it `cancels`, all goals are to be cancelled. So a release starts no motion, also if the engine cancels late.
    """

    def __init__(self, needed: Iterable[str]) -> None:
        self._unknown = set(needed)
        self._engaged = self._holds = False
        self._released_s = 0.0
        self._active: set[str] = set()

    def note_known(self, what: str) -> None:
        """Note that a message of a needed topic has arrived."""
        self._unknown.discard(what)

    def note_estop(self, engaged: bool, now_s: float) -> None:
        """Note the state of the e-stop."""
        if self._engaged and not engaged:
            self._released_s = now_s
        self._engaged = engaged
        self._holds = self._holds or engaged

    def note_goals(self, action: str, are_active: bool) -> None:
        """Note whether an action has goals that have not ended."""
        (self._active.add if are_active else self._active.discard)(action)

    def cancels(self, now_s: float) -> bool:
        """Return whether goals must be cancelled now; requests from before a release may be handled until DRAIN_S after it."""
        if self._holds and not self._engaged and not self._active and now_s - self._released_s >= DRAIN_S:
            self._holds = False
        return self._holds

    def is_open(self, now_s: float) -> bool:
        """Return whether velocities may pass."""
        return not self._unknown and not self.cancels(now_s)
