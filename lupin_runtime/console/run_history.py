"""What has happened in the run, for pages that are opened or loaded again later: events, the mission's states, and the log.

Memory is bounded, however long the run is. Only the events outlive this process, in the command journal.
"""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import Callable, Iterable
from heapq import merge
from typing import Any

from aiohttp import web

from lupin_runtime import graph
from lupin_runtime.console.api_table import Resource
from lupin_runtime.console.command_journal import CommandJournal
from lupin_runtime.console.console_events import ConsoleEvent, RecentEvents
from lupin_runtime.console.encoding import to_json
from lupin_runtime.ros import LupinNode

MAX_STATES = 200
MAX_LINES = 2000
MAX_WARNINGS = 500  # kept apart, so that a flood of other lines does not push them out
MAX_MESSAGE = 2000  # characters of a line
_WARN = 30  # rcl_interfaces/msg/Log.WARN
# A state that differs in one of these makes an event on the page.
_STATE_FIELDS = ("lifecycle_state", "mission_phase", "current_target", "last_error", "estop_engaged", "paused")
_STATE_TEXTS = (*_STATE_FIELDS, "last_event", "last_event_severity")


class MissionStates:
    """The states of the mission that differed from the one before. May be used on any thread."""

    def __init__(self) -> None:
        self._states: deque[dict[str, Any]] = deque(maxlen=MAX_STATES)
        self._lock = threading.Lock()

    def add(self, message: Any) -> None:
        """Keep a `MissionState` if it differs from the last one."""
        state = {name: getattr(message, name) for name in _STATE_TEXTS}
        with self._lock:
            if self._states and all(self._states[-1][name] == state[name] for name in _STATE_FIELDS):
                return
            self._states.append({"header": {"stamp": _stamp(message.header.stamp)}, **state})

    def all(self) -> list[dict[str, Any]]:
        """Return the states with the names of the message's fields, the oldest first."""
        with self._lock:
            return list(self._states)


class LogLines:
    """The newest lines of `/rosout`, and the newest warnings. May be used on any thread."""

    def __init__(self) -> None:
        self._lines: deque[tuple[int, dict[str, Any]]] = deque(maxlen=MAX_LINES)
        self._warnings: deque[tuple[int, dict[str, Any]]] = deque(maxlen=MAX_WARNINGS)
        self._count = 0
        self._lock = threading.Lock()

    def add(self, message: Any) -> None:
        """Keep a `Log` message."""
        line = {
            "stamp": _stamp(message.stamp),
            "level": message.level,
            "name": message.name[:MAX_MESSAGE],
            "msg": message.msg[:MAX_MESSAGE],
            "file": message.file[:MAX_MESSAGE],
            "function": message.function[:MAX_MESSAGE],
            "line": message.line,
        }
        with self._lock:
            self._count += 1
            (self._warnings if message.level >= _WARN else self._lines).append((self._count, line))

    def all(self) -> list[dict[str, Any]]:
        """Return the lines with the names of the message's fields, in the order in which they came."""
        with self._lock:
            lines, warnings = list(self._lines), list(self._warnings)
        return [line for _, line in merge(lines, warnings, key=lambda numbered: numbered[0])]


class RunHistory:
    """Follows the graph, and keeps the console's events. `note` is called on the event loop."""

    def __init__(self, node: LupinNode, journal: CommandJournal, journal_rows: Iterable[Any] = ()) -> None:
        """`journal_rows` are those that an earlier console of the run has left."""
        self._clock = node.get_clock()
        self._journal = journal
        self._events = RecentEvents(list(journal_rows))
        self._states, self._log = MissionStates(), LogLines()
        self._listeners: list[Callable[[dict[str, Any]], None]] = []
        node.subscription(graph.MISSION_STATE, self._states.add)
        node.subscription(graph.ROSOUT, self._log.add)

    def on_event(self, listener: Callable[[dict[str, Any]], None]) -> None:
        """Call `listener` with every event, as browsers get it."""
        self._listeners.append(listener)

    def note(self, event: ConsoleEvent) -> None:
        """Keep an event, pass it on, and write it to the journal. Never raises for a full disk."""
        numbered = self._events.add(event, self._clock.now().nanoseconds / 1e9)
        for listener in self._listeners:
            listener(numbered.as_json())
        self._journal.record_event(event, numbered)

    def resources(self) -> tuple[Resource, ...]:
        """Return the routes, each with a summary of its answer."""
        return (
            Resource(
                "/_api/history",
                self._history,
                "The run so far: changes of stops and of control (`events`), and changed states of the `mission`.",
            ),
            Resource(
                "/_api/history/log", self._lines, f"The last {MAX_LINES} lines of `/rosout`, and {MAX_WARNINGS} warnings."
            ),
        )

    async def _history(self, _: web.Request) -> web.StreamResponse:
        return _json(to_json({"events": self._events.all(), "mission": self._states.all()}))

    async def _lines(self, _: web.Request) -> web.StreamResponse:
        return _json(await asyncio.to_thread(lambda: to_json(self._log.all())))


def _json(body: bytes) -> web.Response:
    return web.Response(body=body, content_type="application/json")


def _stamp(stamp: Any) -> dict[str, int]:
    return {"sec": stamp.sec, "nanosec": stamp.nanosec}
