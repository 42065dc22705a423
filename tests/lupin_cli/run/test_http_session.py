"""All connections of a session are closed when it ends, also if the console never answers the end of TLS."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import ssl
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from lupin_cli.run.http_session import open_session
from lupin_runtime.console.certificate import CertificateStore, ServerCertificate
from tests.support.certificates import client_context
from tests.support.unclosed import unclosed

HEAD = b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n"
ANSWERS = {
    "none": b"",
    "one that keeps the connection": HEAD + b"\r\nok",
    "one that ends the connection": HEAD + b"Connection: close\r\n\r\nok",
    "half of one": HEAD + b"\r\no",
    "more than is read": b"HTTP/1.1 200 OK\r\nContent-Length: 4000000\r\n\r\n" + b"x" * 4_000_000,
}


@pytest.fixture
def store(tmp_path: Path) -> CertificateStore:
    """The certificate of the console."""
    return CertificateStore(tmp_path / "certificate")


@contextlib.contextmanager
def serve(context: ssl.SSLContext, answer: bytes) -> Iterator[int]:
    """Serve one client over TLS, which is answered, and then ignored until the end."""
    ended = threading.Event()

    def run() -> None:
        with contextlib.suppress(OSError):
            answer_client()

    def answer_client() -> None:
        connection, _ = listener.accept()
        with connection, context.wrap_socket(connection, server_side=True) as client:
            client.recv(4096)
            client.sendall(answer)
            ended.wait(60)

    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(20.0)
        thread = threading.Thread(target=run)
        thread.start()
        try:
            yield listener.getsockname()[1]
        finally:
            ended.set()
            thread.join()


@pytest.mark.parametrize("kind", ANSWERS)
def test_every_connection_is_closed_at_the_end(store: CertificateStore, kind: str) -> None:
    server = ServerCertificate(store).context
    trust = client_context(store.root_path.read_bytes())

    async def ask(port: int) -> bytes:
        async with open_session() as session, session.get(f"https://127.0.0.1:{port}/", ssl=trust) as response:
            return await response.content.readexactly(2)

    with (
        unclosed() as found,
        serve(server, ANSWERS[kind]) as port,
        contextlib.suppress(asyncio.TimeoutError),
    ):
        asyncio.run(asyncio.wait_for(ask(port), 0.3))
    assert found == []


def test_websocket_is_closed_at_the_end(store: CertificateStore) -> None:
    upgrade = b"HTTP/1.1 101 Upgrade\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: x\r\n\r\n"

    async def connect(port: int) -> None:
        trust = client_context(store.root_path.read_bytes())
        async with open_session() as session:
            with pytest.raises(Exception, match="Invalid challenge response"):
                await session.ws_connect(f"https://127.0.0.1:{port}/", ssl=trust)

    with unclosed() as found, serve(ServerCertificate(store).context, upgrade) as port:
        asyncio.run(connect(port))
    assert found == []
