"""The clock of the nodes' watchdogs in a test."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator


class WatchdogClock:
    """Monotonic time in ns, `slower` times as slow as it is: every timeout of every node lasts that much longer.

    On a busy machine a heartbeat may be late by more than the watchdog waits for it, and a test that expects a healthy graph
    then sees a stopped robot. With a slow clock it is the watchdog that is late, which no test minds.
    """

    def __init__(self, slower: int) -> None:
        self._lock = threading.Lock()
        self._slower = slower
        self._real_ns = self._shown_ns = time.monotonic_ns()

    def __call__(self) -> int:
        with self._lock:
            return self._now_ns()

    def _now_ns(self) -> int:
        return self._shown_ns + (time.monotonic_ns() - self._real_ns) // self._slower

    def _go(self, slower: int) -> None:
        with self._lock:
            self._shown_ns, self._real_ns = self._now_ns(), time.monotonic_ns()
            self._slower = slower

    @contextlib.contextmanager
    def real(self) -> Iterator[None]:
        """Let time pass as it does in the field: for a wait until a timeout has passed, or for a recording."""
        slower = self._slower
        self._go(1)
        try:
            yield
        finally:
            self._go(slower)
