"""An activity is what the mission does in one top-level state; the orchestrator runs one at a time."""

from __future__ import annotations


class Activity:
    """Base class of activities. Its methods do nothing, so it also serves the states in which nothing happens."""

    def enter(self, substate: str) -> None:
        """Begin a substate of the activity's state; called for each one. `substate` is "" if the state has none."""

    def leave(self) -> None:
        """End the activity; called when its top-level state is left."""

    def stop_motion(self) -> None:
        """Stop moving: the mission was paused, stopped by the e-stop, or sent to the dock."""

    def tick(self) -> None:
        """Advance by one step and return at once. Called after every input, unless `MissionRunner.blocked`."""
