"""Age of a transform, measured by when its stamp last changed: the clocks of robot and laptop differ by seconds."""

from __future__ import annotations


class TransformAge:
    """Tracks the newest stamp of a chain of transforms."""

    def __init__(self) -> None:
        self._newest_ns: int | None = None
        self._since_s: float | None = None

    def age_s(self, newest_ns: int | None, now_s: float) -> float:
        """Return for how many seconds the stamp has been the same; 0 for a chain without stamps (None), which is static."""
        if newest_ns is None:
            return 0.0
        if self._since_s is None or newest_ns != self._newest_ns:
            self._newest_ns, self._since_s = newest_ns, now_s
        return max(0.0, now_s - self._since_s)
