"""A server's connections are closed with it, also those of clients that never answer the end of TLS."""

from __future__ import annotations

import asyncio
import socket
from pathlib import Path

import pytest
from aiohttp import web

from lupin_runtime.console.certificate import CertificateStore, ServerCertificate
from lupin_runtime.console.dual_port import DualPort
from lupin_runtime.console.runner import Runner
from tests.support.certificates import client_context
from tests.support.unclosed import unclosed


@pytest.mark.parametrize("scheme", ["https", "http"])
@pytest.mark.parametrize("path", ["/quick", "/slow", None])
def test_every_connection_is_closed_with_the_server(tmp_path: Path, scheme: str, path: str | None) -> None:
    certificate = ServerCertificate(CertificateStore(tmp_path))
    asked = asyncio.Event()

    async def answer(request: web.Request) -> web.Response:
        asked.set()
        if request.path == "/slow":
            await asyncio.sleep(60.0)
        return web.Response(text="ok")

    async def serve() -> socket.socket:
        application = web.Application()
        application.router.add_get("/{path}", answer)
        runner = Runner(application, shutdown_timeout=0.1)
        await runner.setup()
        assert runner.server is not None
        port = DualPort(runner.server, certificate.context if scheme == "https" else None)
        number = port.open("127.0.0.1", 0)
        client = await asyncio.to_thread(connect, number)
        if path is not None:
            await asyncio.wait_for(asked.wait(), 20.0)
        await port.close()
        await runner.cleanup()
        return client

    def connect(port: int) -> socket.socket:
        client = socket.create_connection(("127.0.0.1", port))
        if scheme == "https":
            trust = client_context(certificate.store.root_path.read_bytes())
            client = trust.wrap_socket(client, server_hostname="localhost")
        if path is not None:
            client.sendall(f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
        return client

    with unclosed() as found:
        loop = asyncio.new_event_loop()  # without the turns that asyncio.run adds at the end
        client = loop.run_until_complete(serve())
        loop.close()
        del loop
        client.close()
    assert found == []
