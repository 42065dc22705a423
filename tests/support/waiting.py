"""Waiting for a condition, with a limit."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


def wait_until(condition: Callable[[], T], what: str | Callable[[], str], limit_s: float = 20.0, every_s: float = 0.05) -> T:
    """Call `condition` until its value is true, and return that value.

    Fails the test after `limit_s` with `what` it waited for; a function is called only then, to describe the state it found.
    """
    deadline = time.monotonic() + limit_s
    while not (value := condition()):
        if time.monotonic() > deadline:
            raise AssertionError(f"not within {limit_s:g} s: {what() if callable(what) else what}")
        time.sleep(every_s)
    return value
