"""A client's WebSocket: reads the client's messages and writes frames to it from a bounded outbox."""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from collections import deque
from collections.abc import AsyncIterator, Callable

from aiohttp import WSCloseCode, WSMsgType, web

from lupin_runtime.console.outbox import Frame, Outbox

MAX_MESSAGE_BYTES = 16_000_000
HEARTBEAT_S = 5.0  # between pings; a client that does not answer one within half of this time is disconnected
_OVERLOAD_PAUSE_S = 0.005
_SEND_TIMEOUT_S = 10.0  # a client that takes longer for one frame is disconnected
_POLL_S = 0.005


class Handoff:
    """Passes frames from other threads to the event loop, waking it once for all frames that arrive together."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._frames: deque[tuple[Connection, Frame]] = deque()
        self._lock = threading.Lock()
        self._woken = False

    def put(self, connection: Connection, frame: Frame) -> None:
        """Queue a frame for a connection. May be called on any thread."""
        with self._lock:
            self._frames.append((connection, frame))
            if self._woken:
                return
            self._woken = True
        with contextlib.suppress(RuntimeError):  # the loop is closed: the console is stopping
            self._loop.call_soon_threadsafe(self._deliver)

    def _deliver(self) -> None:
        with self._lock:
            self._woken = False
            frames, self._frames = self._frames, deque()
        for connection, frame in frames:
            connection.put(frame)


class Connection:
    """A client's WebSocket. All methods are called on the event loop."""

    def __init__(self, socket: web.WebSocketResponse, transport: asyncio.Transport | None) -> None:
        self.socket = socket
        self._transport = transport
        self._outbox = Outbox()
        self._filled = asyncio.Event()
        self._aborted = False
        self._loop = asyncio.get_running_loop()
        self._sending_since_s: float | None = None  # when the writer began to send the current frame; None while it is idle
        self._check: asyncio.TimerHandle | None = None

    def put(self, frame: Frame) -> None:
        """Queue a frame. A client that reads too slowly is disconnected; frames for it are then dropped."""
        if self._aborted:
            return
        self._outbox.put(frame)
        if self._outbox.overflowed:
            # At once: a frame that the client does not take may be blocking the writer, and no closing frame would pass it.
            self.abort()
        self._filled.set()

    def abort(self) -> None:
        """Disconnect the client without waiting for what it has not read yet."""
        self._aborted = True
        self._outbox = Outbox()
        if self._transport is not None:
            self._transport.abort()

    async def close(self, code: int, reason: bytes, timeout_s: float) -> None:
        """Close the connection as the protocol demands; a client that does not respond within `timeout_s` is disconnected."""
        try:
            await asyncio.wait_for(self.socket.close(code=code, message=reason), timeout_s)
        except (asyncio.TimeoutError, ConnectionError):
            self.abort()

    async def serve(self, handle: Callable[[str | bytes], None], is_overloaded: Callable[[], bool]) -> None:
        """Pass the client's messages to `handle` until it disconnects; no messages are read while `is_overloaded()`."""
        writer = asyncio.create_task(self._write())
        try:
            async for message in self.socket:
                if message.type in (WSMsgType.TEXT, WSMsgType.BINARY):
                    handle(message.data)
                while is_overloaded() and not (self.socket.closed or self._aborted):
                    await asyncio.sleep(_OVERLOAD_PAUSE_S)
        finally:
            writer.cancel()
            if self._check is not None:
                self._check.cancel()
            await asyncio.gather(writer, return_exceptions=True)
            if self.socket.exception() is not None:
                self.abort()  # a client that is gone takes nothing of what still waits for it

    async def _write(self) -> None:
        while True:
            await self._filled.wait()
            self._filled.clear()
            while (frame := self._outbox.take()) is not None:
                self._sending_since_s = self._loop.time()
                if self._check is None:
                    self._check = self._loop.call_later(_SEND_TIMEOUT_S, self._check_progress)
                await self.socket.send_frame(frame.data, WSMsgType.BINARY if frame.binary else WSMsgType.TEXT)
            self._sending_since_s = None

    def _check_progress(self) -> None:
        """Disconnect the client if it takes too long for one frame. One timer for many frames: one for each would be slow."""
        self._check = None
        if self._sending_since_s is None:
            return
        left_s = self._sending_since_s + _SEND_TIMEOUT_S - self._loop.time()
        if left_s > 0:
            self._check = self._loop.call_later(left_s, self._check_progress)
        else:
            self.abort()


class Connections:
    """The open connections of all ports. For the event loop only."""

    def __init__(self) -> None:
        self._open: set[Connection] = set()

    @contextlib.asynccontextmanager
    async def accept(self, request: web.Request) -> AsyncIterator[Connection]:
        """Answer a request with a WebSocket, which is open until the end of the block."""
        socket = web.WebSocketResponse(heartbeat=HEARTBEAT_S, max_msg_size=MAX_MESSAGE_BYTES, compress=False)
        await socket.prepare(request)
        connection = Connection(socket, request.transport)
        self._open.add(connection)
        try:
            yield connection
        finally:
            self._open.discard(connection)

    async def close(self, timeout_s: float) -> None:
        """Close all connections at the same time, within `timeout_s`, and wait until they are no longer in use."""
        deadline_s = time.monotonic() + timeout_s
        reason = b"the console is stopping"
        await asyncio.gather(*(each.close(WSCloseCode.GOING_AWAY, reason, timeout_s) for each in self._open))
        while self._open and time.monotonic() < deadline_s + timeout_s:
            await asyncio.sleep(_POLL_S)
