"""The console's HTTP server: port 8090 for browsers, and port 9090 with rosbridge for other programs."""

from __future__ import annotations

import asyncio
import errno
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from aiohttp import web

from lupin_runtime.console.authority import Role, Session
from lupin_runtime.console.bridge import STOP_PERIOD_S, Bridge
from lupin_runtime.console.certificate import ServerCertificate
from lupin_runtime.console.connection import HEARTBEAT_S, MAX_MESSAGE_BYTES, Connection, Handoff
from lupin_runtime.console.dual_port import DualPort
from lupin_runtime.console.origin import MAX_CLIENTS, Origin
from lupin_runtime.console.pairing import PairingCodes
from lupin_runtime.console.ports import PortInUse, owner_of
from lupin_runtime.console.request_rules import host_name
from lupin_runtime.console.rosbridge import RosbridgeClient
from lupin_runtime.console.sessions import Sessions
from lupin_runtime.stack.runs import Run

Address = tuple[str, int]

_START_TIMEOUT_S = 10.0
_STOP_TIMEOUT_S = 2.0


class ConsoleServer:
    """Runs the event loop in its own thread. `start` raises PortInUse and OSError.

    `run` is the run whose state browsers see. `address`, for browsers, and `rosbridge_address` are host and port: port 0 is any
    free one, and an empty host means all of this computer's addresses. Without a certificate browsers are served over HTTP.
    """

    def __init__(
        self,
        bridge: Bridge,
        sessions: Sessions,
        codes: PairingCodes,
        run: Run,
        address: Address,
        rosbridge_address: Address,
        certificate: ServerCertificate | None,
        doctor_command: Sequence[str],
        video_target: str,
        log: Callable[[str], None],
    ) -> None:
        self._bridge = bridge
        self._codes = codes
        self._run = run
        self._address, self._rosbridge_address = address, rosbridge_address
        self._loop = asyncio.new_event_loop()
        self._handoff = Handoff(self._loop)
        self._origin = Origin(
            bridge,
            self._handoff,
            sessions,
            codes,
            doctor_command,
            video_target,
            certificate.store.root_path if certificate else None,
        )
        self._certificate, self._log = certificate, log
        self._clients = 0
        self._number = 0
        self._runners: list[web.AppRunner] = []
        self._port: DualPort | None = None
        self._tasks: list[asyncio.Task[None]] = []
        self._turns = 0
        self._thread = threading.Thread(target=self._loop.run_forever, name="console", daemon=True)

    def start(self) -> tuple[int, int]:
        """Listen; returns the ports for browsers and for rosbridge."""
        self._thread.start()
        return asyncio.run_coroutine_threadsafe(self._open(), self._loop).result(_START_TIMEOUT_S)

    def stop(self) -> None:
        """Close all connections. If a client was driving, this stops the robot."""
        asyncio.run_coroutine_threadsafe(self._close(), self._loop).result(2 * _STOP_TIMEOUT_S)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(_STOP_TIMEOUT_S)
        if not self._thread.is_alive():
            self._loop.close()

    async def _open(self) -> tuple[int, int]:
        host, port = self._address
        runner = await self._start_runner(self._origin.application())
        assert runner.server is not None
        self._port = DualPort(runner.server, self._certificate.context if self._certificate is not None else None)
        with _explained_port_conflict(port):
            port = self._port.open(host, port)
        application = web.Application()
        application.router.add_get("/", self._rosbridge)
        runner = await self._start_runner(application)
        with _explained_port_conflict(self._rosbridge_address[1]):
            await web.TCPSite(runner, *self._rosbridge_address).start()
        self._tasks.append(asyncio.create_task(self._maintain()))
        if self._certificate is not None:
            self._tasks.append(asyncio.create_task(self._certificate.keep_current(self._log)))
        return port, int(runner.addresses[0][1])

    async def _start_runner(self, application: web.Application) -> web.AppRunner:
        runner = web.AppRunner(application, access_log=None, shutdown_timeout=_STOP_TIMEOUT_S)
        await runner.setup()
        self._runners.append(runner)
        return runner

    async def _close(self) -> None:
        for task in self._tasks:
            task.cancel()
        await self._origin.doctor.close()
        await self._origin.video.close()
        if self._port is not None:
            await self._port.close()
        await asyncio.gather(*(runner.cleanup() for runner in self._runners))

    @property
    def turns(self) -> int:
        """A counter that grows every STOP_PERIOD_S while the event loop works."""
        return self._turns

    async def _maintain(self) -> None:
        while True:
            self._turns += 1
            self._bridge.publish_combined_stop()
            self._codes.tick(time.monotonic_ns())
            self._origin.push_state()
            self._origin.push_run(self._run.state())
            self._origin.close_revoked()
            await asyncio.sleep(STOP_PERIOD_S)

    async def _rosbridge(self, request: web.Request) -> web.StreamResponse:
        origin = request.headers.get("Origin")
        if origin is not None and not _is_local(origin):
            # A page of any site can open WebSockets to this machine from the operator's browser.
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
            await connection.serve(client.handle, lambda: self._bridge.is_overloaded(client))
        finally:
            self._clients -= 1
            client.close()
        return socket


@contextmanager
def _explained_port_conflict(port: int) -> Iterator[None]:
    """Raise PortInUse, which names the port's owner, if the port is in use."""
    try:
        yield
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise PortInUse(f"port {port} is in use by {owner_of(port)}") from error
        raise


def _is_local(origin: str) -> bool:
    return host_name(origin.split("://", 1)[-1]) in ("localhost", "127.0.0.1", "::1")
