"""Driving by the keys of a terminal, which tells of presses and their repetitions, but of no release.

A key counts as held for HOLD_S after its last repetition. Then one zero is sent, and nothing more.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from lupin_runtime.drive import ZERO, Twist
from lupin_runtime.teleop.velocity import NORMAL, TURBO

HOLD_S = 0.3
PERIOD_S = 0.05
MAX_KEYS = 8  # that are read at a time: more are text that was pasted

# Directions: forward, left, turn left. The letters are those of the console's page.
DIRECTIONS: Mapping[str, tuple[int, int, int]] = {
    "w": (1, 0, 0),
    "s": (-1, 0, 0),
    "a": (0, 1, 0),
    "d": (0, -1, 0),
    "q": (0, 0, 1),
    "e": (0, 0, -1),
    "\x1b[A": (1, 0, 0),
    "\x1b[B": (-1, 0, 0),
    "\x1b[D": (0, 0, 1),
    "\x1b[C": (0, 0, -1),
}
_KEY = re.compile(r"\x1b(?:\[[0-9;]*|O)[A-Za-z~]|.", re.DOTALL)
_ESCAPE = b"\x1b"
_END_KEYS = (b"x", b"\x03", b"\x04")  # x, Ctrl-C, Ctrl-D


def is_end(typed: bytes) -> bool:
    """Return whether what a terminal sent ends the driving: x, Esc, Ctrl-C or Ctrl-D, also in what was pasted or came late.

    An Esc that other bytes follow begins the sequence of a key.
    """
    return typed == _ESCAPE or any(key in typed for key in _END_KEYS)


def split_keys(text: str) -> list[str]:
    """Return the keys in what a terminal sent: characters, and the sequences of the arrows. None if it was pasted."""
    keys = _KEY.findall(text)
    return keys if len(keys) <= MAX_KEYS else []


class KeyboardDriver:
    """Decides what to send. Times are nanoseconds of the monotonic clock."""

    def __init__(self) -> None:
        self.velocity: Twist | None = None  # that is sent; None while no key is held
        self._pressed_ns = 0
        self._sent_ns: int | None = None

    def press(self, key: str, now_ns: int) -> None:
        """Handle a key: the velocity of a direction, faster with a capital letter. Any other key lets go."""
        direction = DIRECTIONS.get(key) or DIRECTIONS.get(key.lower())
        if direction is None:
            self._pressed_ns = now_ns - int(HOLD_S * 1e9) - 1
            return
        speeds = TURBO if key not in DIRECTIONS else NORMAL
        forward, left, turn = direction
        velocity = Twist(forward * speeds.linear_mps, left * speeds.linear_mps, turn * speeds.yaw_radps)
        if velocity != self.velocity:
            self._sent_ns = None
        self.velocity, self._pressed_ns = velocity, now_ns

    def step(self, now_ns: int) -> Twist | None:
        """Return the velocity to send now, or None; call it at least every PERIOD_S."""
        if self.velocity is None:
            return None
        if not 0 <= now_ns - self._pressed_ns <= HOLD_S * 1e9:
            self.velocity, self._sent_ns = None, None
            return ZERO
        if self._sent_ns is not None and now_ns - self._sent_ns < PERIOD_S * 1e9:
            return None
        self._sent_ns = now_ns
        return self.velocity
