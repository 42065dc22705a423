"""Whether transforms still come, judged by their going on, not by their stamps: two machines' clocks differ by seconds."""

from __future__ import annotations


class Freshness:
    """Watches the newest stamp of a chain of transforms."""

    def __init__(self) -> None:
        self._newest_ns: int | None = None
        self._since_s: float | None = None

    def age_s(self, newest_ns: int | None, now_s: float) -> float:
        """Seconds for which the newest stamp has been the same; 0 for a chain that never changes (None)."""
        if newest_ns is None:
            return 0.0
        if self._since_s is None or newest_ns != self._newest_ns:
            self._newest_ns, self._since_s = newest_ns, now_s
        return max(0.0, now_s - self._since_s)
