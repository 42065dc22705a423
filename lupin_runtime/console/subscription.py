"""One client's subscriptions to one topic, merged into one stream of frames."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass

from lupin_runtime.console.encoding import COMPRESSIONS


@dataclass(frozen=True)
class Request:
    """The options of one `subscribe`: at most one message per `throttle_ms`, and at most `queue_length` waiting messages."""

    throttle_ms: int = 0
    queue_length: int = 0
    compression: str = "none"


class ClientSubscription:
    """All `subscribe` requests of one client for one topic.

    The client gets every message once, at the shortest interval and with the strongest compression that any of its requests
    asks for.
    """

    def __init__(self) -> None:
        self._requests: dict[Hashable, Request] = {}
        self._sent_ns: int | None = None
        self.compression = "none"
        self.queue_length = 0
        self._interval_ns = 0

    @property
    def empty(self) -> bool:
        """Whether no request is left."""
        return not self._requests

    def add(self, identifier: Hashable, request: Request) -> None:
        """Add a request, or replace the one with the same id."""
        self._requests[identifier] = request
        self._merge()

    def remove(self, identifier: Hashable | None) -> None:
        """Remove the request with an id, or all of them if the id is None."""
        if identifier is None:
            self._requests.clear()
        else:
            self._requests.pop(identifier, None)
        self._merge()

    def _merge(self) -> None:
        requests = self._requests.values()
        self._interval_ns = min((request.throttle_ms for request in requests), default=0) * 1_000_000
        self.queue_length = min((request.queue_length for request in requests), default=0)
        self.compression = max((request.compression for request in requests), key=COMPRESSIONS.index, default="none")

    def due(self, now_ns: int) -> bool:
        """Return whether a message that arrives now is to be sent, and if so, count it as sent."""
        if self._sent_ns is not None and 0 <= now_ns - self._sent_ns < self._interval_ns:
            return False
        self._sent_ns = now_ns
        return True
