"""What a pad that drives publishes: a velocity while its dead-man button is held, else nothing.

At the release one zero is published, so that the wheels stop at once instead of after the drive bus's timeout. It is the only
one: a pad that went on sending zeros would keep the drive bus from everything of a lower priority.
"""

from __future__ import annotations

from collections.abc import Mapping

from lupin_runtime.drive import ZERO, Twist
from lupin_runtime.teleop.pad_selection import FirstHeld, Pacer
from lupin_runtime.teleop.pad_state import DeadMan, PadState
from lupin_runtime.teleop.velocity import command_velocity


class PadDriver:
    """Decides what to publish. Of several pads, the one whose dead-man button is held first drives until it is released."""

    def __init__(self) -> None:
        self._held = FirstHeld()
        self._pacer = Pacer(ZERO)

    @property
    def driving(self) -> str | None:
        """The pad that drives."""
        return self._held.selected

    @property
    def delayed(self) -> bool:
        """Whether a change of the velocity waits to be published."""
        return self._pacer.delayed

    def step(self, pads: Mapping[str, PadState], now_ns: int) -> Twist | None:
        """Return the velocity to publish now, or None. `pads` are the connected ones, by the names of their devices."""
        was_driving = self.driving
        if self._held.update([name for name, state in pads.items() if state.dead_man is DeadMan.HELD]):
            self._pacer.restart()
            return ZERO
        if self.driving is None:
            return None
        if was_driving is None:
            self._pacer.restart()
        pad = pads[self.driving]
        velocity = command_velocity(pad.sticks, turbo=pad.turbo, dead_zone=pad.dead_zone)
        return velocity if self._pacer.is_due(velocity, now_ns) else None
