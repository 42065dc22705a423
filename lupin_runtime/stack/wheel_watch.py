"""Whether the wheels turn while they are commanded: the commands of the input that drives, compared with the odometry."""

from __future__ import annotations

from lupin_runtime.drive.twist import Twist

# A base that is slower may stand: friction, and the dead band of the motors' driver.
MIN_MPS, MIN_RADPS = 0.05, 0.2
GAP_S = 0.5  # commands that are further apart are no stream
# The odometry's serialized message: encapsulation and stamp, then all that encoders change. They report the wheels at rest as
# exactly the same numbers.
_STAMPED_BYTES = 4 + 8


class WheelWatch:
    """Measures the longest time for which the odometry arrived unchanged while the wheels were commanded. Times are s."""

    def __init__(self) -> None:
        self.idle_s = 0.0
        self._since_s: float | None = None  # since when the wheels are commanded and have not moved
        self._commanded_s = 0.0
        self._source = ""  # of the last command
        self._winner: str | None = None  # the input that drives; None: not known yet
        self._odometry = b""

    def command(self, source: str, twist: Twist | None, now_s: float) -> None:
        """Handle a command on the bus's input `source`; None stands for a malformed one. Those of other inputs do not count."""
        if self._winner not in (None, source):
            return
        is_moving = twist is not None and (max(abs(twist.x), abs(twist.y)) >= MIN_MPS or abs(twist.yaw) >= MIN_RADPS)
        if not is_moving:
            self._since_s = None
        elif self._since_s is None or source != self._source or now_s - self._commanded_s > GAP_S:
            self._since_s = now_s
        self._source, self._commanded_s = source, now_s

    def bus(self, winner: str, is_locked: bool) -> None:
        """Handle a status of the drive bus: the input that drives, and whether the bus passes nothing."""
        if is_locked or winner != self._source:
            self._since_s = None
        self._winner = "" if is_locked else winner

    def odometry(self, message: bytes, now_s: float) -> None:
        """Handle a serialized message of the odometry."""
        content = message[_STAMPED_BYTES:]
        if content != self._odometry:
            self._odometry = content
            self._since_s = now_s if self._since_s is not None else None
        elif self._since_s is not None and now_s - self._commanded_s <= GAP_S:
            self.idle_s = max(self.idle_s, now_s - self._since_s)
