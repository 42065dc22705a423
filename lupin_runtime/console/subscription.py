"""One client's subscriptions to one topic, merged into one stream of frames."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
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
        self._merged = Request()

    @property
    def compression(self) -> str:
        """The strongest compression that a request asks for."""
        return self._merged.compression

    @property
    def queue_length(self) -> int:
        """The shortest queue that a request asks for; 0 for the topic's own."""
        return self._merged.queue_length

    def __len__(self) -> int:
        return len(self._requests)

    def __contains__(self, identifier: Hashable) -> bool:
        return identifier in self._requests

    def add(self, identifier: Hashable, request: Request) -> None:
        """Add a request, or replace the one with the same id."""
        others = [self._merged] if self._requests and identifier not in self._requests else self._others(identifier)
        self._requests[identifier] = request
        self._merged = _merge([*others, request])

    def remove(self, identifier: Hashable | None) -> None:
        """Remove the request with an id, or all of them if the id is None."""
        if identifier is None:
            self._requests.clear()
        else:
            self._requests.pop(identifier, None)
        self._merged = _merge(list(self._requests.values()) or [Request()])

    def _others(self, identifier: Hashable) -> list[Request]:
        return [request for key, request in self._requests.items() if key != identifier]

    def due(self, now_ns: int) -> bool:
        """Return whether a message that arrives now is to be sent, and if so, count it as sent."""
        if self._sent_ns is not None and 0 <= now_ns - self._sent_ns < self._merged.throttle_ms * 1_000_000:
            return False
        self._sent_ns = now_ns
        return True


def _merge(requests: Sequence[Request]) -> Request:
    return Request(
        min(request.throttle_ms for request in requests),
        min(request.queue_length for request in requests),
        max((request.compression for request in requests), key=COMPRESSIONS.index),
    )
