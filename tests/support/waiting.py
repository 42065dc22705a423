"""Wait for a condition, with a timeout."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


def wait_until(
    condition: Callable[[], T], what: str | Callable[[], str], timeout_s: float = 20.0, interval_s: float = 0.05
) -> T:
    """Call `condition` until its value is true, and return that value.

    Fails the test after `timeout_s` with a message that contains `what`. A function `what` is called only then, so that it can
    describe the state at that time.
    """
    deadline = time.monotonic() + timeout_s
    while not (value := condition()):
        if time.monotonic() > deadline:
            raise AssertionError(f"waited {timeout_s:g} s for: {what() if callable(what) else what}")
        time.sleep(interval_s)
    return value
