"""Detects motion of the arm from noisy joint angles."""

from __future__ import annotations

from collections.abc import Sequence


class MotionDetector:
    """Reports motion for `hold_s` after a joint has moved by more than `deadband_rad` since the last detection.

    Slow motion accumulates until it exceeds the dead band. Times are nanoseconds of one clock.
    """

    def __init__(self, deadband_rad: float, hold_s: float) -> None:
        self._deadband_rad, self._hold_ns = deadband_rad, int(hold_s * 1e9)
        self._reference: tuple[float, ...] | None = None
        self._moved_ns: int | None = None

    def update(self, angles_rad: Sequence[float], now_ns: int) -> None:
        """Handle the joints' angles, always in the same order."""
        angles = tuple(angles_rad)
        if self._reference is None or len(self._reference) != len(angles):
            self._reference = angles  # the first angles are the reference, not a motion
        elif any(abs(a - b) > self._deadband_rad for a, b in zip(angles, self._reference)):
            self._reference, self._moved_ns = angles, now_ns

    def moving(self, now_ns: int) -> bool:
        """Return whether the arm is moving."""
        return self._moved_ns is not None and 0 <= now_ns - self._moved_ns <= self._hold_ns
