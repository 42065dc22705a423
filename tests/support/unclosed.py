"""Finds sockets and transports that were never closed."""

from __future__ import annotations

import gc
import warnings
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def unclosed() -> Iterator[list[str]]:
    """Return what was dropped inside without being closed; the list is complete at the end."""
    found: list[str] = []
    gc.collect()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ResourceWarning)
        yield found
        gc.collect()
    found += [str(each.message) for each in caught if issubclass(each.category, ResourceWarning)]
