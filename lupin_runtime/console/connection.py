"""A client's WebSocket: reads the client's messages and writes frames to it from a bounded outbox."""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import Callable

from aiohttp import WSCloseCode, WSMsgType, web

from lupin_runtime.console.outbox import Frame, Outbox

MAX_MESSAGE_BYTES = 16_000_000
HEARTBEAT_S = 5.0  # between pings; a client that does not answer one within half of this time is disconnected
_OVERLOAD_PAUSE_S = 0.005


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
        self._loop.call_soon_threadsafe(self._deliver)

    def _deliver(self) -> None:
        with self._lock:
            self._woken = False
            frames, self._frames = self._frames, deque()
        for connection, frame in frames:
            connection.put(frame)


class Connection:
    """A client's WebSocket. All methods are called on the event loop."""

    def __init__(self, socket: web.WebSocketResponse) -> None:
        self._socket = socket
        self._outbox = Outbox()
        self._filled = asyncio.Event()

    def put(self, frame: Frame) -> None:
        """Queue a frame. A client that reads too slowly is disconnected."""
        self._outbox.put(frame)
        self._filled.set()

    async def serve(self, handle: Callable[[str | bytes], None], is_overloaded: Callable[[], bool]) -> None:
        """Pass the client's messages to `handle` until it disconnects; no messages are read while `is_overloaded()`."""
        writer = asyncio.create_task(self._write())
        try:
            async for message in self._socket:
                if message.type in (WSMsgType.TEXT, WSMsgType.BINARY):
                    handle(message.data)
                while is_overloaded() and not self._socket.closed:
                    await asyncio.sleep(_OVERLOAD_PAUSE_S)
        finally:
            writer.cancel()
            await asyncio.gather(writer, return_exceptions=True)

    async def _write(self) -> None:
        while True:
            await self._filled.wait()
            self._filled.clear()
            if self._outbox.overflowed:
                await self._socket.close(code=WSCloseCode.TRY_AGAIN_LATER, message=b"too slow: messages are piling up")
                return
            while (frame := self._outbox.take()) is not None:
                await self._socket.send_frame(frame.data, WSMsgType.BINARY if frame.binary else WSMsgType.TEXT)
