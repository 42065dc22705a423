"""A TLS server like the console's: clients that trust the authority are served, and no others."""

from __future__ import annotations

import asyncio
import datetime
import ssl
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from aiohttp import ClientConnectorCertificateError, ClientSession, TCPConnector, web

from lupin_runtime.console.certificate import CertificateStore, ServerCertificate
from lupin_runtime.console.runner import Runner
from tests.support.certificates import HostStore, client_context, handshake, reachable

LIMIT_S = 60.0


@pytest.fixture
def store(tmp_path: Path) -> CertificateStore:
    """A store with this machine's own names and clock."""
    return CertificateStore(tmp_path / "certificate")


@asynccontextmanager
async def serving(certificate: ServerCertificate) -> AsyncIterator[int]:
    application = web.Application()
    application.router.add_get("/", _answer)
    runner = Runner(application)
    await runner.setup()
    site = web.TCPSite(runner, "127.0.0.1", 0, ssl_context=certificate.context)
    await site.start()
    try:
        yield int(runner.addresses[0][1])
    finally:
        await runner.cleanup()


async def _answer(_: web.Request) -> web.Response:
    return web.Response(text="the console")


async def fetch(port: int, root: bytes | None, name: str = "localhost") -> str:
    """Return the server's answer to a client that calls it `name`, which need not resolve on this machine."""
    url = f"https://127.0.0.1:{port}/"
    async with (
        ClientSession(connector=TCPConnector(ssl=client_context(root))) as session,
        session.get(url, server_hostname=name) as response,
    ):
        return await response.text()


def test_client_that_trusts_the_authority_is_served(store: CertificateStore) -> None:
    async def scenario() -> None:
        certificate = ServerCertificate(store)
        root = store.root_path.read_bytes()
        async with serving(certificate) as port:
            for name in ("localhost", "127.0.0.1"):
                assert await fetch(port, root, name) == "the console"

    asyncio.run(asyncio.wait_for(scenario(), LIMIT_S))


def test_client_that_does_not_trust_it_refuses(store: CertificateStore, tmp_path: Path) -> None:
    other = HostStore(tmp_path / "other")
    other.ensure()

    async def scenario() -> None:
        async with serving(ServerCertificate(store)) as port:
            for root in (None, other.root_path.read_bytes()):
                with pytest.raises(ClientConnectorCertificateError):
                    await fetch(port, root)

    asyncio.run(asyncio.wait_for(scenario(), LIMIT_S))


def test_name_of_another_host_is_refused(store: CertificateStore) -> None:
    certificate = ServerCertificate(store)
    with pytest.raises(ssl.SSLCertVerificationError, match="Hostname mismatch"):
        handshake(certificate.context, client_context(store.root_path.read_bytes()), "printer.local")


def test_tls_older_than_1_2_is_refused(store: CertificateStore) -> None:
    certificate = ServerCertificate(store)
    client = client_context(store.root_path.read_bytes())
    client.maximum_version = ssl.TLSVersion.TLSv1_2
    assert handshake(certificate.context, client, "localhost").version() == "TLSv1.2"
    assert certificate.context.minimum_version == ssl.TLSVersion.TLSv1_2


def test_server_renews_its_certificate_after_clock_step(tmp_path: Path) -> None:
    now = datetime.datetime.now(datetime.timezone.utc)
    wrong = now + datetime.timedelta(days=3000)
    store = HostStore(tmp_path / "certificate", now=wrong)
    certificate = ServerCertificate(store)
    root, log = store.root_path.read_bytes(), list[str]()

    async def scenario() -> None:
        keeper = asyncio.create_task(certificate.keep_current(log.append, period_s=0.01))
        with pytest.raises(ssl.SSLCertVerificationError, match="not yet valid"):
            handshake(certificate.context, client_context(root), "localhost")
        store.now = now
        while not log:
            await asyncio.sleep(0.01)
        store.host_addresses = reachable("10.42.0.2")
        while len(log) < 2:
            await asyncio.sleep(0.01)
        keeper.cancel()

    asyncio.run(asyncio.wait_for(scenario(), LIMIT_S))
    assert log == [
        f"the server's certificate was renewed: it was issued on {wrong:%Y-%m-%d}, after the clock's current time",
        "the server's certificate was renewed: it lacks 10.42.0.2",
    ]
    assert handshake(certificate.context, client_context(root), "10.42.0.2").version() == "TLSv1.3"


def test_server_keeps_certificate_that_cannot_be_renewed(tmp_path: Path) -> None:
    store = HostStore(tmp_path / "certificate")
    certificate = ServerCertificate(store)
    before, log = certificate.certificates.leaf.sha256, list[str]()

    async def scenario() -> None:
        keeper = asyncio.create_task(certificate.keep_current(log.append, period_s=0.01))
        store.folder.rename(tmp_path / "moved")
        store.folder.write_text("a file where the folder was")
        while not log:
            await asyncio.sleep(0.01)
        store.folder.unlink()
        (tmp_path / "moved").rename(store.folder)
        store.host_addresses = reachable("10.42.0.2")
        while len(log) < 2:
            await asyncio.sleep(0.01)
        keeper.cancel()

    asyncio.run(asyncio.wait_for(scenario(), LIMIT_S))
    assert "cannot be read or written" in log[0]
    assert certificate.certificates.leaf.sha256 != before


def test_certificate_renewed_by_another_process_is_served(tmp_path: Path) -> None:
    store, log = HostStore(tmp_path / "certificate"), list[str]()
    certificate = ServerCertificate(store)

    async def scenario() -> None:
        keeper = asyncio.create_task(certificate.keep_current(log.append, period_s=0.01))
        HostStore(store.folder, "192.168.1.20", "10.42.0.2").ensure()
        while not log:
            await asyncio.sleep(0.01)
        keeper.cancel()

    asyncio.run(asyncio.wait_for(scenario(), LIMIT_S))
    assert log == ["the server's certificate was renewed: by another process"]
