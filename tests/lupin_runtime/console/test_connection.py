"""Clients that do not read, without a graph: each is disconnected in time, and little waits for it until then."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import pytest
from aiohttp import web

from lupin_runtime.console import connection
from lupin_runtime.console.connection import Connection, Connections
from lupin_runtime.console.outbox import MAX_BYTES, Frame
from tests.support.raw_websocket import open_raw_websocket, text_frame
from tests.support.waiting import WAIT_S, wait_until

Answer = Callable[[Connection], None]


class Server:
    """Answers every message with `answer`, and records the most that ever waited for a client."""

    def __init__(self, answer: Answer) -> None:
        self._answer = answer
        self._connections = Connections()
        self.port = 0
        self.most_waiting_bytes = 0
        self.ended = asyncio.Event()

    async def serve(self, request: web.Request) -> web.StreamResponse:
        async with self._connections.accept(request) as accepted:

            def handle(_: str | bytes) -> None:
                self._answer(accepted)
                self.most_waiting_bytes = max(self.most_waiting_bytes, accepted._outbox.waiting_bytes)

            await accepted.serve(handle, lambda: False)
        self.ended.set()
        return accepted.socket


@asynccontextmanager
async def serving(answer: Answer) -> AsyncIterator[Server]:
    server = Server(answer)
    application = web.Application()
    application.router.add_get("/", server.serve)
    runner = web.AppRunner(application, shutdown_timeout=0.1)
    await runner.setup()
    await web.TCPSite(runner, "127.0.0.1", 0).start()
    server.port = runner.addresses[0][1]
    try:
        yield server
    finally:
        await runner.cleanup()


def send_until_disconnected(port: int) -> None:
    """Send messages without reading any answer, until the server ends the connection."""
    with open_raw_websocket(port, receive_buffer=4096) as client, contextlib.suppress(ConnectionError):
        wait_until(lambda: client.sendall(text_frame("x") * 50), "the end of the connection", interval_s=0.01)


def test_client_that_sends_but_never_reads_is_disconnected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "_SEND_TIMEOUT_S", 10 * WAIT_S)  # what waits for it is the reason, not the time

    async def scenario() -> None:
        async with serving(lambda client: client.put(Frame(b"x" * 20_000))) as server:
            await asyncio.to_thread(send_until_disconnected, server.port)
            await asyncio.wait_for(server.ended.wait(), WAIT_S)
            assert server.most_waiting_bytes <= MAX_BYTES + 20_000

    asyncio.run(scenario())


def test_client_that_is_too_slow_for_a_frame_is_disconnected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "_SEND_TIMEOUT_S", 0.5)

    async def scenario() -> None:
        # Samples of one topic: all but the newest few are dropped, so that they never exceed a limit.
        async with serving(lambda client: client.put(Frame(b"x" * 500_000, stream="/camera", depth=1))) as server:
            await asyncio.to_thread(send_until_disconnected, server.port)
            await asyncio.wait_for(server.ended.wait(), WAIT_S)

    asyncio.run(scenario())


def test_frames_for_a_disconnected_client_are_dropped() -> None:
    made: list[Connection] = []

    async def scenario() -> None:
        async with serving(made.append) as server:
            client = await asyncio.to_thread(open_raw_websocket, server.port)
            client.sendall(text_frame("x"))
            while not made:
                await asyncio.sleep(0.01)
            for _ in range(10):
                made[0].put(Frame(b"x" * MAX_BYTES))
            assert made[0]._outbox.waiting_bytes == 0
            await asyncio.wait_for(server.ended.wait(), WAIT_S)
            client.close()

    asyncio.run(scenario())


@pytest.mark.parametrize("reads", [False, True])
def test_client_that_answers_no_ping_is_disconnected(monkeypatch: pytest.MonkeyPatch, reads: bool) -> None:
    monkeypatch.setattr(connection, "HEARTBEAT_S", 0.4)

    async def scenario() -> None:
        async with serving(lambda _: None) as server:
            client = await asyncio.to_thread(open_raw_websocket, server.port)
            reading = asyncio.create_task(asyncio.to_thread(_read_all, client)) if reads else None
            await asyncio.wait_for(server.ended.wait(), WAIT_S)
            if reading is not None:
                await reading
            client.close()

    asyncio.run(scenario())


def _read_all(client: socket.socket) -> None:
    with contextlib.suppress(ConnectionError):
        while client.recv(1000):
            pass
