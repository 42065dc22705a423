"""The clock of the nodes' watchdogs in a test."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator


class WatchdogClock:
    """Monotonic time in ns. It is real until `slow_down` stretches every timeout of every node.

    On a busy machine a heartbeat may be late by more than the watchdog waits for it, and a test that expects a healthy graph
    then sees a stopped robot. With a slow clock it is the watchdog that is late, which no test minds.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._times = 1
        self._real_ns = self._shown_ns = time.monotonic_ns()

    def __call__(self) -> int:
        with self._lock:
            return self._now_ns()

    def _now_ns(self) -> int:
        return self._shown_ns + (time.monotonic_ns() - self._real_ns) // self._times

    def slow_down(self, times: int) -> None:
        """From now on, let every timeout last `times` as long."""
        with self._lock:
            self._shown_ns, self._real_ns = self._now_ns(), time.monotonic_ns()
            self._times = times

    @contextlib.contextmanager
    def real(self) -> Iterator[None]:
        """Let timeouts last as long as they do in the field within the context: for a wait until one has passed."""
        times = self._times
        self.slow_down(1)
        try:
            yield
        finally:
            self.slow_down(times)
