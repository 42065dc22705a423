"""`/_api/voice`: the voice agent of a browser, or of `lupin voice`, calls tools through this WebSocket.

The client sends one JSON object a message:

* `{"turn": {"id", "by", "ended"}}`: the operator begins a turn, by `speech`, `text` or `button`. A speaker's turn is announced
  when speech begins, with `ended` false, and again when it ends.
* `{"call": {"id", "name", "arguments"}}`: the model calls a tool.
* `{"cancel": true}`: the operator interrupts. A burst ends, what was read back is forgotten, and calls that wait are dropped.
* `{"alive": true}`: a sign of life, for a client that has no other connection.
* `{"listen": {"mode", "start_level", "end_level"}}`: have the console hear the microphone, of which each binary message is a
  frame of `lupin_runtime/voice/endpointer.py`. In the mode `stops`, words for stopping engage the e-stop; in `commands`, turns
  in speech are recognized, too, for the agent without a model; `off` ends it.
* `{"closed": true}`: this page may not move the robot, for example as its release button was not held yet; false ends it.
* `{"say": {"id", "text", "language"}}` and `{"answer": {"id", "agrees"}}`: a sentence for the agent without a model, and a
  button that answers what it has read back. Each is a turn with this id.
* `{"refused": {"name", "arguments", "reason"}}`: what the page itself has refused, for the journal.

The server answers `{"result": {"id", "name", "response"}}` for each call, and sends `{"cut_off": reason}` if the agent is cut
off, `{"stop_heard": text}` for a word for stopping, `{"heard": {"id", "text", "problem"}}` for a turn in speech, and for a
sentence `{"reply": ...}` and a binary message with its sound; `{"state": ...}` when that changes, and `{"error": text}` for a
message that it does not understand.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping
from concurrent.futures import Future
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from typing import Any

from aiohttp import WSCloseCode, web

from lupin_runtime.console.api_table import SESSION
from lupin_runtime.console.authority import Session
from lupin_runtime.console.bridge import Bridge
from lupin_runtime.console.connection import Connection
from lupin_runtime.console.robot_watch import RobotWatch
from lupin_runtime.console.settings import SETTINGS
from lupin_runtime.console.voice_listener import VoiceListener
from lupin_runtime.console.voice_robot import ChangeLocation
from lupin_runtime.console.voice_session import VoiceSession
from lupin_runtime.ros import LupinNode
from lupin_runtime.voice.envelope import Envelope

MAX_ENVELOPES = 256
_CLOSE_TIMEOUT_S = 1.0
_MOVED = b"the voice agent of this browser goes on in another tab"
_DEFAULTS: dict[str, Any] = {setting.name: setting.default for setting in SETTINGS}

Accept = Callable[[web.Request], AbstractAsyncContextManager[Connection]]


class VoiceAgents:
    """The voice sessions of all browsers, at most one of each. Used on the event loop.

    `settings` returns the settings that were changed.
    """

    def __init__(
        self,
        bridge: Bridge,
        accept: Accept,
        note_alive: Callable[[Session], None],
        settings: Callable[[], Mapping[str, Any]],
        change_location: ChangeLocation,
    ) -> None:
        self._bridge = bridge
        self._accept = accept
        self._note_alive = note_alive
        self._settings: Callable[[], dict[str, Any]] = lambda: {**_DEFAULTS, **settings()}
        self._change_location = change_location
        # An envelope outlives its connection: an agent that was cut off is not free again once it has connected again.
        self._envelopes: dict[Session, Envelope] = {}
        self._connections: dict[Session, Connection] = {}
        self._listener = VoiceListener()
        self._watch: Future[RobotWatch] | None = None  # while any session is open
        self._users = 0

    async def serve(self, request: web.Request) -> web.StreamResponse:
        """Serve the WebSocket of a session. Another one of the same session is closed."""
        session = request[SESSION]
        async with self._accept(request) as connection:
            if (replaced := self._connections.get(session)) is not None:
                await replaced.close(WSCloseCode.POLICY_VIOLATION, _MOVED, _CLOSE_TIMEOUT_S)
            self._connections[session] = connection
            try:
                async with self._watching() as watch:
                    await self._serve(session, connection, watch)
            finally:
                if self._connections.get(session) is connection:
                    del self._connections[session]
        return connection.socket

    async def close(self) -> None:
        """End the listener."""
        await self._listener.close()

    async def _serve(self, session: Session, connection: Connection, watch: RobotWatch) -> None:
        envelope = self._envelope(session)
        agent = VoiceSession(
            session, self._bridge, envelope, watch, self._settings, self._change_location, connection.put, self._listener
        )

        def handle(text: str | bytes) -> None:
            self._note_alive(session)
            agent.handle(text)

        try:
            await connection.serve(handle, lambda: agent.is_overloaded)
        finally:
            agent.close()

    def _envelope(self, session: Session) -> Envelope:
        if session not in self._envelopes and len(self._envelopes) >= MAX_ENVELOPES:
            left = next((each for each in self._envelopes if each not in self._connections), None)
            if left is not None:  # or all are in use
                del self._envelopes[left]
        return self._envelopes.setdefault(session, Envelope())

    @asynccontextmanager
    async def _watching(self) -> AsyncIterator[RobotWatch]:
        """Follow the robot while any session is open."""
        names = self._settings()

        def create(node: LupinNode) -> RobotWatch:
            return RobotWatch(node, names)

        self._users += 1
        try:
            if self._watch is None:
                self._watch = self._bridge.run_with_node(create)
            yield await asyncio.shield(asyncio.wrap_future(self._watch))
        finally:
            self._users -= 1
            if self._users == 0 and self._watch is not None:
                created, self._watch = self._watch, None
                self._bridge.run_with_node(lambda _: created.result().close())  # after it was created, on the same thread
