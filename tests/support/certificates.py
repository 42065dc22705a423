"""A certificate store whose addresses and clock the test sets, and TLS clients that trust a given root."""

from __future__ import annotations

import datetime
import ipaddress
import ssl
from pathlib import Path

from lupin_runtime.console.certificate import CertificateStore
from lupin_runtime.console.host_addresses import HostAddresses

TODAY = datetime.datetime(2027, 3, 1, 12, tzinfo=datetime.timezone.utc)


def utc(year: int, month: int = 1, day: int = 1) -> datetime.datetime:
    """Return midnight of a day, in UTC."""
    return datetime.datetime(year, month, day, tzinfo=datetime.timezone.utc)


def reachable(*addresses: str, names: tuple[str, ...] = ("lab-7.local", "lab-7")) -> HostAddresses:
    """Return the addresses and names by which a host is reachable."""
    return HostAddresses(names, tuple(map(ipaddress.ip_address, addresses)))


class HostStore(CertificateStore):
    """The certificate store of a host; tests may change its time `now` and its `host_addresses`."""

    def __init__(self, folder: Path, *addresses: str, now: datetime.datetime = TODAY) -> None:
        super().__init__(folder, lambda: self.now, lambda: self.host_addresses)
        self.now = now
        self.host_addresses = reachable(*(addresses or ("192.168.1.20",)))


def client_context(root: bytes | None) -> ssl.SSLContext:
    """Return a client's TLS context that trusts only `root` (PEM), or nothing if that is None."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.verify_flags |= ssl.VERIFY_X509_STRICT
    if root is not None:
        context.load_verify_locations(cadata=root.decode())
    return context


def handshake(server: ssl.SSLContext, client: ssl.SSLContext, host: str) -> ssl.SSLObject:
    """Connect client and server in memory; return the client's side. Raises ssl.SSLError if the client rejects the server."""
    to_server, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
    client_side = client.wrap_bio(to_client, to_server, server_hostname=host)
    server_side = server.wrap_bio(to_server, to_client, server_side=True)
    for _ in range(8):
        done = True
        for side in (client_side, server_side):
            try:
                side.do_handshake()
            except ssl.SSLWantReadError:
                done = False
        if done:
            return client_side
    raise AssertionError("the TLS handshake did not finish within 8 rounds")
