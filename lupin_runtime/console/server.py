"""The console's HTTP server: rosbridge for other clients, on a port of its own."""

from __future__ import annotations

import asyncio
import errno
import threading

from aiohttp import web

from lupin_runtime.console.authority import Role, Session
from lupin_runtime.console.bridge import STOP_PERIOD_S, Bridge
from lupin_runtime.console.connection import HEARTBEAT_S, MAX_MESSAGE_BYTES, Connection, Handoff
from lupin_runtime.console.ports import PortInUse, owner_of
from lupin_runtime.console.rosbridge import RosbridgeClient

MAX_CLIENTS = 256
_START_S = 10.0
_STOP_S = 2.0


class ConsoleServer:
    """Runs the event loop in a thread of its own. `start` raises PortInUse and OSError."""

    def __init__(self, bridge: Bridge, host: str, rosbridge_port: int) -> None:
        self._bridge = bridge
        self._host = host
        self._port = rosbridge_port
        self._loop = asyncio.new_event_loop()
        self._handoff = Handoff(self._loop)
        self._clients = 0
        self._number = 0
        self._runner: web.AppRunner | None = None
        self._stop_timer: asyncio.Task[None] | None = None
        self._turns = 0
        self._thread = threading.Thread(target=self._loop.run_forever, name="console", daemon=True)

    def start(self) -> int:
        """Listen; returns the port, which the system chooses where 0 was given."""
        self._thread.start()
        return asyncio.run_coroutine_threadsafe(self._open(), self._loop).result(_START_S)

    def stop(self) -> None:
        """Close all connections, which stops a robot that one of them drives."""
        asyncio.run_coroutine_threadsafe(self._close(), self._loop).result(2 * _STOP_S)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(_STOP_S)
        if not self._thread.is_alive():
            self._loop.close()

    async def _open(self) -> int:
        application = web.Application()
        application.router.add_get("/", self._rosbridge)
        self._runner = web.AppRunner(application, access_log=None, shutdown_timeout=_STOP_S)
        await self._runner.setup()
        site = web.TCPSite(self._runner, self._host, self._port)
        try:
            await site.start()
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                raise PortInUse(f"port {self._port} is in use by {owner_of(self._port)}") from error
            raise
        self._stop_timer = asyncio.create_task(self._repeat_stop())
        return int(self._runner.addresses[0][1])

    async def _close(self) -> None:
        if self._stop_timer is not None:
            self._stop_timer.cancel()
        if self._runner is not None:
            await self._runner.cleanup()

    @property
    def turns(self) -> int:
        """How often the event loop has come round; it grows every STOP_PERIOD_S while the loop works."""
        return self._turns

    async def _repeat_stop(self) -> None:
        while True:
            self._turns += 1
            self._bridge.state_combined_stop()
            await asyncio.sleep(STOP_PERIOD_S)

    async def _rosbridge(self, request: web.Request) -> web.StreamResponse:
        origin = request.headers.get("Origin")
        if origin is not None and not _is_local(origin):
            # A page of another site may open WebSockets to this machine from the operator's browser.
            raise web.HTTPForbidden(text=f"pages of {origin} may not use this server\n")
        if self._clients >= MAX_CLIENTS:
            raise web.HTTPServiceUnavailable(text=f"{MAX_CLIENTS} clients are connected\n")
        socket = web.WebSocketResponse(heartbeat=HEARTBEAT_S, max_msg_size=MAX_MESSAGE_BYTES, compress=False)
        await socket.prepare(request)
        connection = Connection(socket)
        self._number += 1
        session = Session(f"client {self._number} of {request.remote}", Role.OPERATOR)
        client = RosbridgeClient(session, self._bridge, lambda frame: self._handoff.put(connection, frame))
        self._clients += 1
        try:
            await connection.serve(client.handle, lambda: self._bridge.overloaded(client))
        finally:
            self._clients -= 1
            client.close()
        return socket


def _is_local(origin: str) -> bool:
    host = origin.split("://", 1)[-1]
    name = host.rsplit("]", 1)[0].lstrip("[") if host.startswith("[") else host.split(":", 1)[0]
    return name in ("localhost", "127.0.0.1", "::1")
