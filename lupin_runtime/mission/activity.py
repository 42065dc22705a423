"""An activity is what the mission does in one top-level state; the orchestrator runs one at a time."""

from __future__ import annotations


class Activity:
    """Base class, and the activity of states in which nothing happens."""

    def enter(self, leaf: str) -> None:
        """A leaf of the activity's state becomes active; `leaf` is "" for states without leaves."""

    def leave(self) -> None:
        """The top-level state ends."""

    def stop_motion(self) -> None:
        """Stop moving: the mission is paused, stopped or diverted."""

    def tick(self) -> None:
        """Advance by one step, without blocking. Called about 10 times a second, but not while the mission is blocked."""
