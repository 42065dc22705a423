"""Lets several playbook runs share the laptop: one call at a time, and one step at a time."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from lupin_cli.connection.base import Target
from lupin_cli.connection.forwarding import ForwardingTarget


class SerializedTarget(ForwardingTarget):
    """Serializes the calls of several runs. Two steps that edit the same file at once would lose each other's changes."""

    def __init__(self, target: Target) -> None:
        super().__init__(target)
        self._lock = threading.RLock()

    @contextmanager
    def reserved(self) -> Iterator[None]:
        """Keep the target for the calling thread until the context ends."""
        with self._lock:
            yield

    @contextmanager
    def forwarded(self, timeout_s: float) -> Iterator[tuple[Target, float]]:
        with self.reserved():
            yield self._target, timeout_s

    def close(self) -> None:
        """Do nothing: the laptop needs no connection."""
