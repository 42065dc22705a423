"""Wait for a condition, with a timeout: the one loop of all tests that wait."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")

# Three times the longest legal time, the 20 s of a DDS lease: a wait that ends by its limit has found a defect.
WAIT_S = 60.0


def wait_for_nothing(seconds: float, _what: str) -> None:
    """Give time to something that must not happen. If a slow machine needs more, the test passes; it never fails by that."""
    time.sleep(seconds)


def wait_until(
    condition: Callable[[], T | None],
    what: str | Callable[[], str],
    timeout_s: float = WAIT_S,
    interval_s: float = 0.05,
    each: Callable[[], object] = lambda: None,
) -> T:
    """Call `condition` until its value is true, and return that value; call `each` before, every time.

    Fails the test after `timeout_s` with a message that contains `what`. A function `what` is called only then, so that it can
    describe the state at that time.
    """
    deadline = time.monotonic() + timeout_s
    while True:
        each()
        if value := condition():
            return value
        if time.monotonic() > deadline:
            raise AssertionError(f"waited {timeout_s:g} s for: {what() if callable(what) else what}")
        time.sleep(interval_s)
