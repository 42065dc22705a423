"""The connection of `lupin voice` to a console: `/_api/voice`, whose protocol docs/voice.md describes."""

from __future__ import annotations

import asyncio
import contextlib
import json
import ssl
import uuid
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from lupin_cli.run.http_session import open_session
from lupin_runtime.json_text import parse_json

if TYPE_CHECKING:
    from aiohttp import ClientWebSocketResponse

ANSWER_TIMEOUT_S = 40.0  # the console itself gives up a service after less
BURST_TIMEOUT_S = 4.0  # a burst lasts at most 2 s
_ALIVE_S = 2.0
CONNECT_TIMEOUT_S = 10.0  # of the connection with its TLS, and again of the answer
OTHER_VERSION = "it may be of another version; compare here and there: lupin --version"


class ConnectionLost(ConnectionError):
    """The console cannot be reached, or has closed the connection; the text says why."""


@dataclass(frozen=True)
class Console:
    """How to connect to a console: its URL without a path, the authority to trust, the cookie, and what to do if it is lost."""

    url: str
    trust: ssl.SSLContext | None = None
    cookie: str = field(default="", repr=False)
    next_step: str = "see it with: lupin console code"


class VoiceConnection:
    """Sends turns and calls, and follows the state of the session."""

    def __init__(self, socket: ClientWebSocketResponse, next_step: str) -> None:
        self._socket = socket
        self._next_step = next_step
        self._answers: dict[str, asyncio.Future[dict[str, Any]]] = {}
        self._changed = asyncio.Event()
        self._lost = ""
        self._ended = asyncio.Event()
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
            raise ConnectionLost(f"the connection to the console is lost: {error}; {self._next_step}") from error

    async def receive(self) -> None:
        """Handle what the console sends, until the connection ends."""
        try:
            self._lost = f"{await self._receive()}; {self._next_step}"
        except (ValueError, TypeError, LookupError, AttributeError) as error:
            self._lost = f"the console sent what this version does not understand ({error!r}); {OTHER_VERSION}"
        self._changed.set()
        self._ended.set()
        for answer in self._answers.values():
            if not answer.done():
                answer.set_exception(ConnectionLost(self._lost))

    async def _receive(self) -> str:
        """Return why the connection has ended."""
        from aiohttp import WSMsgType

        while True:
            message = await self._socket.receive()
            if message.type is WSMsgType.TEXT:
                self._handle(parse_json(message.data))
            elif message.type is WSMsgType.CLOSE:
                return f"the console closed the connection: {message.extra or message.data}"
            elif message.type is not WSMsgType.BINARY:
                return f"the connection to the console is lost ({self._socket.exception() or self._socket.close_code})"

    async def wait_until_lost(self) -> None:
        """Wait for the end of the connection, and raise ConnectionLost."""
        await self._ended.wait()
        raise ConnectionLost(self._lost)

    def _handle(self, message: dict[str, Any]) -> None:
        if "error" in message:
            raise ValueError(f"it answers: {str(message['error'])[:200]}")
        if "state" in message:
            self.state = dict(message["state"])
            self._changed.set()
        result = message.get("result")
        if result is not None and (answer := self._answers.get(result["id"])) is not None and not answer.done():
            answer.set_result(dict(result["response"]))

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
async def connect(console: Console) -> AsyncIterator[VoiceConnection]:
    """Connect to a console. Raises ConnectionLost."""
    import aiohttp

    timeout = aiohttp.ClientTimeout(total=None, sock_connect=CONNECT_TIMEOUT_S)
    options: dict[str, Any] = {} if console.trust is None else {"ssl": console.trust}
    headers = {"Cookie": console.cookie} if console.cookie else {}
    async with open_session(timeout=timeout) as session:
        opening = session.ws_connect(f"{console.url}/_api/voice", heartbeat=5.0, headers=headers, **options)
        try:
            socket = await asyncio.wait_for(opening, 2 * CONNECT_TIMEOUT_S)
        except aiohttp.WSServerHandshakeError as error:
            raise ConnectionLost(_refusal(console, error.status)) from error
        except asyncio.TimeoutError as error:
            raise ConnectionLost(f"no answer of the voice service at {console.url}; {console.next_step}") from error
        except (aiohttp.ClientError, OSError) as error:
            raise ConnectionLost(f"no voice service at {console.url}: {error}; start a run with: lupin up") from error
        connection = VoiceConnection(socket, console.next_step)
        tasks = [asyncio.ensure_future(connection.receive()), asyncio.ensure_future(connection.keep_alive())]
        try:
            yield connection
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            await socket.close()


def _refusal(console: Console, status: int) -> str:
    """Return what a console means that opens no connection."""
    if status == 401:
        return f"{console.url} does not know this computer any more; {console.next_step}"
    if status == 503:
        return f"{console.url} serves no more clients, or cannot read its files; {console.next_step}"
    return f"{console.url} has no voice service ({status}); {OTHER_VERSION}"
