"""Selects the pad that drives, and what it publishes: a velocity while its dead-man button is held, else nothing.

At the release one zero is published, so that the wheels stop at once instead of after the drive bus's timeout. It is the only
one: a pad that went on sending zeros would keep the drive bus from everything of a lower priority.
"""

from __future__ import annotations

from collections.abc import Mapping

from lupin_runtime.drive import ZERO, Twist
from lupin_runtime.teleop.pad_state import DeadMan, PadState
from lupin_runtime.teleop.velocity import command_velocity

PERIOD_S = 0.05
MIN_PERIOD_S = 0.01  # between two changes of the velocity: a pad may send 1000 reports a second


class PadDriver:
    """Decides what to publish. Of several pads, the one whose dead-man button is held first drives until it is released."""

    def __init__(self) -> None:
        self.driving: str | None = None  # the pad that drives
        self.delayed = False  # whether a change waits for MIN_PERIOD_S to pass
        self._refused: set[str] = set()  # pads that were held while another one drove: they must be released first
        self._sent = ZERO
        self._sent_ns: int | None = None

    def step(self, pads: Mapping[str, PadState], now_ns: int) -> Twist | None:
        """Return the velocity to publish now, or None. `pads` are the connected ones, by the names of their devices."""
        self.delayed = False
        held = [key for key, state in pads.items() if state.dead_man is DeadMan.HELD]
        self._refused &= set(held)
        if self.driving is not None and self.driving not in held:
            self.driving, self._sent_ns = None, None
            self._refused.update(held)
            return ZERO
        if self.driving is None:
            self.driving = next((key for key in held if key not in self._refused), None)
            self._sent_ns = None
        self._refused.update(key for key in held if key != self.driving)
        if self.driving is None:
            return None
        pad = pads[self.driving]
        velocity = command_velocity(pad.sticks, turbo=pad.turbo, dead_zone=pad.dead_zone)
        if not self._is_due(velocity, now_ns):
            self.delayed = velocity != self._sent
            return None
        self._sent, self._sent_ns = velocity, now_ns
        return velocity

    def _is_due(self, velocity: Twist, now_ns: int) -> bool:
        if self._sent_ns is None:
            return True
        since_s = (now_ns - self._sent_ns) / 1e9
        # A zero is never delayed.
        return since_s >= PERIOD_S or (velocity != self._sent and (since_s >= MIN_PERIOD_S or velocity == ZERO))
