"""The connection of `lupin voice` to a console: `/_api/voice`, whose protocol docs/voice.md describes."""

from __future__ import annotations

import asyncio
import contextlib
import json
import uuid
from collections.abc import AsyncIterator
from typing import TYPE_CHECKING, Any

from lupin_runtime.json_text import parse_json

if TYPE_CHECKING:
    from aiohttp import ClientWebSocketResponse

ANSWER_TIMEOUT_S = 40.0  # the console itself gives up a service after less
BURST_TIMEOUT_S = 4.0  # a burst lasts at most 2 s
_ALIVE_S = 2.0
_CONNECT_TIMEOUT_S = 10.0


class ConnectionLost(ConnectionError):
    """The console cannot be reached, or has closed the connection; the text says why."""


class VoiceConnection:
    """Sends turns and calls, and follows the state of the session."""

    def __init__(self, socket: ClientWebSocketResponse) -> None:
        self._socket = socket
        self._answers: dict[str, asyncio.Future[dict[str, Any]]] = {}
        self._changed = asyncio.Event()
        self._lost = ""
        self.state: dict[str, Any] = {}

    async def announce_turn(self, identifier: str, by: str, *, ended: bool = True) -> None:
        """Announce that the operator begins a turn, or ends the one with this id."""
        await self._send({"turn": {"id": identifier, "by": by, "ended": ended}})

    async def call(self, tool: str, arguments: dict[str, Any]) -> dict[str, Any]:
        """Call a tool, and return its response. Raises ConnectionLost."""
        identifier = new_identifier()
        answer = self._answers[identifier] = asyncio.get_running_loop().create_future()
        await self._send({"call": {"id": identifier, "name": tool, "arguments": arguments}})
        try:
            return await asyncio.wait_for(answer, ANSWER_TIMEOUT_S)
        except asyncio.TimeoutError as error:
            raise ConnectionLost(f"the console has not answered {tool} for {ANSWER_TIMEOUT_S:.0f} s") from error
        finally:
            del self._answers[identifier]

    async def interrupt(self) -> None:
        """Say no: what was read back is forgotten, and what waits is dropped."""
        await self._send({"cancel": True})

    async def wait_until_idle(self) -> None:
        """Return when no burst is running, and no call waits: they would end with the connection."""
        with contextlib.suppress(asyncio.TimeoutError):
            await asyncio.wait_for(self._wait_until_idle(), BURST_TIMEOUT_S)

    async def _wait_until_idle(self) -> None:
        while (self.state.get("is_driving") or self.state.get("waiting")) and not self._lost:
            self._changed.clear()
            await self._changed.wait()

    async def _send(self, message: dict[str, Any]) -> None:
        if self._lost:
            raise ConnectionLost(self._lost)
        try:
            await self._socket.send_str(json.dumps(message))
        except ConnectionError as error:
            raise ConnectionLost(f"the console closed the connection: {error}") from error

    async def receive(self) -> None:
        """Handle what the console sends, until the connection ends."""
        async for message in self._socket:
            if isinstance(message.data, str):
                self._handle(parse_json(message.data))
        reason = self._socket.close_code or "without a reason"
        self._lost = f"the console closed the connection ({reason}); see it with: lupin console code"
        self._changed.set()
        for answer in self._answers.values():
            if not answer.done():
                answer.set_exception(ConnectionLost(self._lost))

    def _handle(self, message: dict[str, Any]) -> None:
        if "state" in message:
            self.state = message["state"]
            self._changed.set()
        result = message.get("result")
        if result is not None and (answer := self._answers.get(result["id"])) is not None and not answer.done():
            answer.set_result(result["response"])

    async def keep_alive(self) -> None:
        """Send signs of life: control is lost without them."""
        while True:
            await asyncio.sleep(_ALIVE_S)
            with contextlib.suppress(ConnectionLost):
                await self._send({"alive": True})


def new_identifier() -> str:
    """Return an identifier that is never used twice."""
    return uuid.uuid4().hex


@contextlib.asynccontextmanager
async def connect(url: str) -> AsyncIterator[VoiceConnection]:
    """Connect to the console at a URL such as http://127.0.0.1:8090/. Raises ConnectionLost."""
    import aiohttp

    timeout = aiohttp.ClientTimeout(total=None, sock_connect=_CONNECT_TIMEOUT_S)
    async with aiohttp.ClientSession(timeout=timeout) as session:
        try:
            socket = await session.ws_connect(f"{url.rstrip('/')}/_api/voice", heartbeat=5.0)
        except (aiohttp.ClientError, asyncio.TimeoutError, OSError) as error:
            raise ConnectionLost(f"no voice service at {url}: {error}; start a run with: lupin up") from error
        connection = VoiceConnection(socket)
        tasks = [asyncio.ensure_future(connection.receive()), asyncio.ensure_future(connection.keep_alive())]
        try:
            yield connection
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            await socket.close()
