"""Turns the repeated e-stop state into edges: the repeats are there for late joiners, not for those who listen."""

from __future__ import annotations

import enum


class EStopEdge(enum.Enum):
    """What just changed."""

    ENGAGED = "engaged"
    RELEASED = "released"


class EStopMonitor:
    """Starts released, as nothing was heard yet; `engaged` is the last state heard."""

    def __init__(self) -> None:
        self.engaged = False

    def update(self, engaged: bool) -> EStopEdge | None:
        """Take a message of the e-stop state; returns the edge that it brought, if any."""
        if engaged == self.engaged:
            return None
        self.engaged = engaged
        return EStopEdge.ENGAGED if engaged else EStopEdge.RELEASED
