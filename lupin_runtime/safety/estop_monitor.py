"""Evaluates the repeated e-stop state, on whose topic any node of the graph can publish.

One message engages; a release needs evidence, because a single false may come from a node that is not the e-stop bridge.
"""

from __future__ import annotations

import enum
from collections.abc import Callable

# The bridge repeats its state at 5 Hz: a release takes effect after QUIET_S and at most one more period.
RELEASE_COUNT = 3
QUIET_S = 0.5
# Requests that were queued in a process at the release are handled within this (real) time. They are older than the release, so
# whoever moves something refuses requests for that long.
DRAIN_S = 0.1

# Why a command is refused.
ESTOP_ENGAGED = "e-stop engaged"
ESTOP_NOT_RECEIVED = "no e-stop state received yet"
ESTOP_SILENT = "no e-stop state for"  # and the duration


class EStopEdge(enum.Enum):
    """A change of the e-stop state."""

    ENGAGED = "engaged"
    RELEASED = "released"


class EStopMonitor:
    """`engaged` is set by the first true; it is clear before the first message.

    It is cleared by RELEASE_COUNT falses in a row and QUIET_S without a true, while the topic has exactly one publisher.
    A second node that publishes false therefore cannot clear it.
    """

    def __init__(self, publisher_count: Callable[[], int] = lambda: 1) -> None:
        """`publisher_count` returns the topic's number of publishers; it is called only if all else allows a release."""
        self.engaged = False
        self._publisher_count = publisher_count
        self._falses = 0
        self._true_ns = 0

    def update(self, engaged: bool, now_ns: int) -> EStopEdge | None:
        """Handle a message of the e-stop state; return the edge that it caused, or None."""
        if engaged:
            self._true_ns, self._falses = now_ns, 0
            edge = None if self.engaged else EStopEdge.ENGAGED
            self.engaged = True
            return edge
        if not self.engaged:
            return None
        self._falses += 1
        self._true_ns = min(self._true_ns, now_ns)  # a clock that was set back: the quiet time begins again
        quiet = now_ns - self._true_ns >= QUIET_S * 1e9
        if self._falses < RELEASE_COUNT or not quiet or self._publisher_count() != 1:
            return None
        self.engaged = False
        return EStopEdge.RELEASED
