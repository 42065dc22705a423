"""One port for HTTPS and HTTP, also with clients that send nothing or too little."""

from __future__ import annotations

import asyncio
import socket
import ssl
from collections.abc import AsyncIterator
from contextlib import ExitStack, asynccontextmanager
from datetime import datetime, timedelta, timezone
from pathlib import Path

import aiohttp
import pytest
from aiohttp import web
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from lupin_runtime.console import dual_port
from lupin_runtime.console.dual_port import DualPort
from lupin_runtime.console.runner import Runner

TIMEOUT_S = 60.0


@pytest.fixture
def tls(tmp_path: Path) -> ssl.SSLContext:
    """A server's TLS context with a self-signed certificate."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "localhost")])
    now = datetime.now(timezone.utc)
    builder = x509.CertificateBuilder().subject_name(name).issuer_name(name).public_key(key.public_key())
    builder = builder.serial_number(1).not_valid_before(now - timedelta(days=1)).not_valid_after(now + timedelta(days=1))
    certificate = builder.sign(key, hashes.SHA256())
    private = serialization.PrivateFormat.PKCS8
    pem = key.private_bytes(serialization.Encoding.PEM, private, serialization.NoEncryption())
    path = tmp_path / "server.pem"
    path.write_bytes(pem + certificate.public_bytes(serialization.Encoding.PEM))
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(path)
    return context


@asynccontextmanager
async def serving(context: ssl.SSLContext | None) -> AsyncIterator[int]:
    async def answer(request: web.Request) -> web.Response:
        return web.Response(text=request.scheme)

    application = web.Application()
    application.router.add_get("/", answer)
    runner = Runner(application)
    await runner.setup()
    assert runner.server is not None
    port = DualPort(runner.server, context)
    number = port.open("127.0.0.1", 0)
    try:
        yield number
    finally:
        await port.close()
        await runner.cleanup()


async def get(url: str) -> str:
    async with (
        aiohttp.ClientSession(timeout=aiohttp.ClientTimeout(TIMEOUT_S)) as session,
        session.get(url, ssl=False) as answer,
    ):
        return await answer.text()


def test_one_port_serves_http_and_https(tls: ssl.SSLContext) -> None:
    async def scenario() -> None:
        async with serving(tls) as port:
            assert await get(f"http://127.0.0.1:{port}/") == "http"
            assert await get(f"https://127.0.0.1:{port}/") == "https"

    asyncio.run(scenario())


def test_port_without_certificate_serves_http() -> None:
    async def scenario() -> None:
        async with serving(None) as port:
            assert await get(f"http://127.0.0.1:{port}/") == "http"
            with pytest.raises(aiohttp.ClientError):
                await get(f"https://127.0.0.1:{port}/")

    asyncio.run(scenario())


@pytest.mark.parametrize("first", [b"", b"\x16", b"\x16\x03\x01\x02\x00\x01", b"\x00" * 100, b"G", b"GET / HTTP/1.1\r\nHost:"])
def test_silent_or_malformed_client_does_not_block_others(tls: ssl.SSLContext, first: bytes) -> None:
    async def scenario() -> None:
        async with serving(tls) as port:
            with socket.create_connection(("127.0.0.1", port), TIMEOUT_S) as half:
                half.sendall(first)
                assert await get(f"https://127.0.0.1:{port}/") == "https"
            assert await get(f"http://127.0.0.1:{port}/") == "http"

    asyncio.run(scenario())


def test_silent_client_is_disconnected(tls: ssl.SSLContext, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dual_port, "_FIRST_BYTE_TIMEOUT_S", 0.2)

    async def scenario() -> None:
        async with serving(tls) as port:
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            assert await asyncio.wait_for(reader.read(), TIMEOUT_S) == b""
            writer.close()

    asyncio.run(scenario())


def test_connections_per_address_are_limited_and_released(tls: ssl.SSLContext, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dual_port, "_MAX_PER_ADDRESS", 3)
    monkeypatch.setattr(dual_port, "_is_loopback", lambda _: False)

    async def scenario() -> None:
        async with serving(tls) as port:
            held = [await asyncio.open_connection("127.0.0.1", port) for _ in range(3)]
            for _, writer in held:
                writer.write(b"GET / HTTP/1.1\r\n")
                await writer.drain()
            while True:  # until the three connections were given to the factory
                try:
                    await get(f"http://127.0.0.1:{port}/")
                except aiohttp.ClientError:
                    break
            for _, writer in held:
                writer.close()
                await writer.wait_closed()
            while True:
                try:
                    assert await get(f"http://127.0.0.1:{port}/") == "http"
                except aiohttp.ClientError:
                    continue
                break

    asyncio.run(asyncio.wait_for(scenario(), 2 * TIMEOUT_S))


@pytest.mark.parametrize("is_loopback", [True, False])
def test_silent_connections_of_one_address_keep_nobody_out(
    tls: ssl.SSLContext, monkeypatch: pytest.MonkeyPatch, is_loopback: bool
) -> None:
    monkeypatch.setattr(dual_port, "_is_loopback", lambda _: is_loopback)

    async def scenario() -> None:
        async with serving(tls) as port:
            with ExitStack() as silent:
                for _ in range(300):
                    _, writer = await asyncio.open_connection("127.0.0.1", port)
                    silent.callback(writer.close)
                assert await get(f"http://127.0.0.1:{port}/") == "http"
                assert await get(f"https://127.0.0.1:{port}/") == "https"

    asyncio.run(asyncio.wait_for(scenario(), 2 * TIMEOUT_S))


def test_silent_connections_of_many_addresses_keep_nobody_out(tls: ssl.SSLContext, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dual_port, "_is_loopback", lambda _: False)

    async def scenario() -> None:
        async with serving(tls) as port:
            with ExitStack() as silent:
                for number in range(300):
                    source = (f"127.0.0.{2 + number % 30}", 0)
                    _, writer = await asyncio.open_connection("127.0.0.1", port, local_addr=source)
                    silent.callback(writer.close)
                assert await get(f"https://127.0.0.1:{port}/") == "https"

    asyncio.run(asyncio.wait_for(scenario(), 2 * TIMEOUT_S))


def test_paired_connection_does_not_count_for_its_address(tls: ssl.SSLContext, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dual_port, "_MAX_PER_ADDRESS", 3)
    monkeypatch.setattr(dual_port, "_is_loopback", lambda _: False)

    async def scenario() -> None:
        opened: list[asyncio.BaseTransport] = []

        class Recorder(asyncio.Protocol):
            def connection_made(self, transport: asyncio.BaseTransport) -> None:
                self.transport = transport

            def data_received(self, _: bytes) -> None:
                port.exempt(self.transport)
                opened.append(self.transport)

        port = DualPort(Recorder, tls)
        number = port.open("127.0.0.1", 0)
        with ExitStack() as clients:
            for count in range(1, 8):
                _, writer = await asyncio.open_connection("127.0.0.1", number)
                clients.callback(writer.close)
                writer.write(b"GET / HTTP/1.1\r\n")
                while len(opened) < count:
                    await asyncio.sleep(0.01)
        await port.close()

    asyncio.run(asyncio.wait_for(scenario(), TIMEOUT_S))
