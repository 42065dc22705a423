"""Refuses commands that have waited since before a stop, its release, or a change of control.

Commands wait for the executor behind the requests of all clients, and then up to a second for their server; stops, releases and
changes of control do not wait. Whoever releases the stop expects that nothing moves without a newer command, and whoever takes
control that nobody else's command follows.
"""

from __future__ import annotations

from collections.abc import Callable

# Returns why a command may not be carried out any more; empty if it may.
Refusal = Callable[[], str]

OUTDATED = "since this was sent, the robot was stopped or released, or control has passed to somebody else; send it again"


class CommandEra:
    """Counts what makes earlier commands outdated. A refusal may be called on any thread, all else only on the event loop.

    `estop_changes` counts how often the e-stop, by whatever button, was engaged or released; it is called on any thread.
    """

    def __init__(self, estop_changes: Callable[[], int]) -> None:
        self._estop_changes = estop_changes
        self._is_stopped = False
        self._stop_changes = 0
        self._holder: str | None = None  # who had control last
        self._handovers = 0

    def note_stop(self, engaged: bool) -> None:
        """Note whether the clients engage the stop."""
        self._stop_changes += engaged != self._is_stopped
        self._is_stopped = engaged

    def note_holder(self, name: str | None) -> None:
        """Note who has control. Giving it up outdates nothing: a program may send a command and disconnect."""
        if name is not None:
            self._handovers += name != self._holder
            self._holder = name

    def refusal(self) -> Refusal:
        """Return what a command that is sent now must ask before it is carried out."""
        sent = self._now()
        return lambda: OUTDATED if self._now() != sent else ""

    def _now(self) -> tuple[int, int, int]:
        return self._stop_changes, self._handovers, self._estop_changes()


def always_valid() -> str:
    """Refuse nothing: the Refusal of a request that moves nothing, or stops something."""
    return ""
