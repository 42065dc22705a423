"""Pushes changes to every browser over one WebSocket channel."""

from __future__ import annotations

from typing import Any

from lupin_runtime.console.connection import Connection
from lupin_runtime.console.encoding import json_frame, to_json
from lupin_runtime.console.outbox import Frame


class EventChannel:
    """The listening browsers, and the last event of each kind, which a new listener gets first. For the event loop only."""

    def __init__(self) -> None:
        self._listeners: set[Connection] = set()
        self._last: dict[str, dict[str, Any]] = {}

    def join(self, connection: Connection) -> None:
        """Add a listener."""
        self._listeners.add(connection)
        for event in self._last.values():
            connection.put(_frame(event))

    def leave(self, connection: Connection) -> None:
        """Remove a listener."""
        self._listeners.discard(connection)

    def push(self, kind: str, value: Any) -> None:
        """Send a value to all listeners if it differs from the last one of its kind."""
        event = {"event": kind, "value": value}
        if self._last.get(kind) == event:
            return
        self._last[kind] = event
        frame = _frame(event)
        for connection in self._listeners:
            connection.put(frame)


def _frame(event: dict[str, Any]) -> Frame:
    return json_frame(to_json(event))
