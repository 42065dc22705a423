"""Whether the arm moves, from joint angles that tremble."""

from __future__ import annotations

from collections.abc import Sequence


class MotionDetector:
    """Moving, while some joint has gone further than `deadband_rad` from where it was last seen to move, within the last
    `hold_s`. A slow motion adds up until it counts. Times are nanoseconds of one clock."""

    def __init__(self, deadband_rad: float, hold_s: float) -> None:
        self._deadband_rad, self._hold_ns = deadband_rad, int(hold_s * 1e9)
        self._reference: tuple[float, ...] | None = None
        self._moved_ns: int | None = None

    def update(self, angles_rad: Sequence[float], now_ns: int) -> None:
        """Take the joints' angles, in the same order every time."""
        angles = tuple(angles_rad)
        if self._reference is None or len(self._reference) != len(angles):
            self._reference = angles  # where it is at first is not a motion
        elif any(abs(a - b) > self._deadband_rad for a, b in zip(angles, self._reference)):
            self._reference, self._moved_ns = angles, now_ns

    def moving(self, now_ns: int) -> bool:
        """Whether it moves now."""
        return self._moved_ns is not None and 0 <= now_ns - self._moved_ns <= self._hold_ns
