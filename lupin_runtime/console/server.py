"""The console's HTTP server: port 8090 for browsers, and port 9090 with rosbridge for other programs."""

from __future__ import annotations

import asyncio
import concurrent.futures
import errno
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from aiohttp import web

from lupin_runtime.console.api_table import SESSION, Handler
from lupin_runtime.console.authority import Role, Session
from lupin_runtime.console.bridge import Bridge
from lupin_runtime.console.certificate import ServerCertificate
from lupin_runtime.console.connection import Connections, Handoff
from lupin_runtime.console.dual_port import DualPort
from lupin_runtime.console.listeners import listen
from lupin_runtime.console.manual_control import STOP_PERIOD_S
from lupin_runtime.console.origin import MAX_CLIENTS, Origin
from lupin_runtime.console.pairing import PairingCodes
from lupin_runtime.console.ports import PortInUse, owner_of
from lupin_runtime.console.request_rules import host_name, is_loopback
from lupin_runtime.console.rosbridge import RosbridgeClient
from lupin_runtime.console.runner import Runner
from lupin_runtime.console.sessions import Sessions
from lupin_runtime.stack.runs import Run

Address = tuple[str, int]

_START_TIMEOUT_S = 10.0
# The stop has about 2 s: half a second for clients to close their connections, the rest for those that do not respond.
_CLOSE_TIMEOUT_S = 0.5
_HANDLER_TIMEOUT_S = 0.2  # for requests that are being answered
_STOP_TIMEOUT_S = 2.0
_RUN_PERIOD_S = 0.5
_PAIR_FIRST = "this port serves programs on this computer; others pair at /_api/pair of the page's port, and use /_ros there\n"


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
        overrides_file: Path,
        log: Callable[[str], None],
    ) -> None:
        self._bridge = bridge
        self._codes = codes
        self._run = run
        self._address, self._rosbridge_address = address, rosbridge_address
        self._loop = asyncio.new_event_loop()
        self._handoff = Handoff(self._loop)
        self._connections = Connections()
        self._origin = Origin(
            bridge,
            self._handoff,
            self._connections,
            sessions,
            codes,
            doctor_command,
            video_target,
            run,
            overrides_file,
            address[0],
            certificate.store.root_path if certificate else None,
        )
        self._certificate, self._log = certificate, log
        self._clients = 0
        self._number = 0
        self._runners: list[Runner] = []
        self._port: DualPort | None = None
        self._tasks: list[asyncio.Task[None]] = []
        self._turns = 0
        self._errors: dict[str, str] = {}  # the last error of each repeated step that fails
        self._thread = threading.Thread(target=self._loop.run_forever, name="console", daemon=True)

    def start(self) -> tuple[int, int]:
        """Listen; returns the ports for browsers and for rosbridge. The latter is 0 if another process uses that port."""
        self._thread.start()
        return asyncio.run_coroutine_threadsafe(self._open(), self._loop).result(_START_TIMEOUT_S)

    def stop(self) -> None:
        """Close all connections. If a client was driving, this stops the robot."""
        try:
            asyncio.run_coroutine_threadsafe(self._close(), self._loop).result(_STOP_TIMEOUT_S)
        except concurrent.futures.TimeoutError:
            self._log(f"the console's connections were not closed within {_STOP_TIMEOUT_S:g} s")
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(_STOP_TIMEOUT_S)
        if not self._thread.is_alive():
            self._loop.close()

    async def _open(self) -> tuple[int, int]:
        rosbridge_port = await self._open_rosbridge()
        host, port = self._address
        application = self._origin.application()
        application.middlewares.append(self._exempt_paired)
        runner = await self._start_runner(application)
        assert runner.server is not None
        self._port = DualPort(runner.server, self._certificate.context if self._certificate is not None else None)
        with _explained_port_conflict(port):
            port = self._port.open(host, port)
        self._tasks += [asyncio.create_task(self._maintain()), asyncio.create_task(self._follow_run())]
        if self._certificate is not None:
            self._tasks.append(asyncio.create_task(self._certificate.keep_current(self._log)))
        return port, rosbridge_port

    async def _open_rosbridge(self) -> int:
        application = web.Application()
        application.router.add_get("/", self._rosbridge)
        runner = await self._start_runner(application)
        try:
            with _explained_port_conflict(self._rosbridge_address[1]):
                for listener in listen(*self._rosbridge_address):
                    await web.SockSite(runner, listener).start()
        except PortInUse as error:
            # Often the vendor's rosbridge. Browsers use the other port.
            self._log(f"no rosbridge for programs: {error}; choose another port with --rosbridge-port")
            return 0
        return int(runner.addresses[0][1])

    async def _start_runner(self, application: web.Application) -> Runner:
        runner = Runner(application, access_log=None, shutdown_timeout=_HANDLER_TIMEOUT_S)
        await runner.setup()
        self._runners.append(runner)
        return runner

    async def _close(self) -> None:
        for task in self._tasks:
            task.cancel()
        if self._port is not None:
            await self._port.close()
        closing = (
            self._connections.close(_CLOSE_TIMEOUT_S),
            self._origin.video.close(),
            self._origin.voice_tokens.close(),
            self._origin.close_voice(),
            asyncio.wait_for(self._origin.doctor.close(), 2 * _CLOSE_TIMEOUT_S),
        )
        for error in await asyncio.gather(*closing, return_exceptions=True):
            if isinstance(error, Exception):
                self._log(f"while the console stopped: {error!r}")
        await asyncio.gather(*(runner.cleanup() for runner in self._runners))

    @web.middleware
    async def _exempt_paired(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        if SESSION in request and request.transport is not None and self._port is not None:
            self._port.exempt(request.transport)
        return await handler(request)

    @property
    def turns(self) -> int:
        """A counter that grows every STOP_PERIOD_S while the event loop works."""
        return self._turns

    async def _maintain(self) -> None:
        periodic_tasks: dict[str, Callable[[], None]] = {
            "repeating the stop": self._bridge.manual.publish_combined_stop,
            "replacing the pairing codes": lambda: self._codes.tick(time.monotonic_ns()),
            "pushing control and stop": self._origin.push_state,
            "disconnecting revoked browsers": self._origin.close_revoked,
        }
        while True:
            self._turns += 1
            for name, run in periodic_tasks.items():
                with self._logged_error(name):
                    run()
            await asyncio.sleep(STOP_PERIOD_S)

    async def _follow_run(self) -> None:
        """Push the run's state, which is read from the disk and must not delay the stop."""
        while True:
            with self._logged_error("reading the run's state"):
                self._origin.push_run(await asyncio.to_thread(self._run.state))
            await asyncio.sleep(_RUN_PERIOD_S)

    @contextmanager
    def _logged_error(self, task: str) -> Iterator[None]:
        """Log an error of a periodic task once, and go on: whatever fails, on a full disk for example, the stop is repeated."""
        try:
            yield
        except Exception as error:  # any defect of one task must not end the others
            if self._errors.get(task) != repr(error):
                self._log(f"{task} failed: {''.join(traceback.format_exception(error))}")
            self._errors[task] = repr(error)
        else:
            self._errors.pop(task, None)

    async def _rosbridge(self, request: web.Request) -> web.StreamResponse:
        origin = request.headers.get("Origin")
        if origin is not None and not _is_local(origin):
            # A page of any site can open WebSockets to this machine from the operator's browser.
            raise web.HTTPForbidden(text=f"pages of {origin} may not use this server\n")
        if not is_loopback(request):
            return await self._serve_paired(request)
        if self._clients >= MAX_CLIENTS:
            raise web.HTTPServiceUnavailable(text=f"{MAX_CLIENTS} clients are connected\n")
        async with self._connections.accept(request) as connection:
            self._number += 1
            session = Session(f"client {self._number} of {request.remote}", Role.OPERATOR)
            client = RosbridgeClient(session, self._bridge, lambda frame: self._handoff.put(connection, frame))
            self._clients += 1
            try:
                await connection.serve(client.handle, lambda: self._bridge.is_overloaded(client))
            finally:
                self._clients -= 1
                client.close()
        return connection.socket

    async def _serve_paired(self, request: web.Request) -> web.StreamResponse:
        """Serve a program on another computer, which is an operator or a viewer only by the token of its pairing."""
        session = self._origin.find_session(request)
        if session is None:
            raise web.HTTPForbidden(text=_PAIR_FIRST)
        request[SESSION] = session
        return await self._origin.serve_rosbridge(request)


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
