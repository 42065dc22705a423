"""A certificate store whose host and clock the test decides, and TLS clients that trust what they are told to."""

from __future__ import annotations

import datetime
import ipaddress
import ssl
from pathlib import Path

from lupin_runtime.console.certificate import CertificateStore
from lupin_runtime.console.host_addresses import HostAddresses

TODAY = datetime.datetime(2027, 3, 1, 12, tzinfo=datetime.timezone.utc)


def utc(year: int, month: int = 1, day: int = 1) -> datetime.datetime:
    """Midnight of a day, in UTC."""
    return datetime.datetime(year, month, day, tzinfo=datetime.timezone.utc)


def reachable(*addresses: str, names: tuple[str, ...] = ("lab-7.local", "lab-7")) -> HostAddresses:
    """A host of these addresses."""
    return HostAddresses(names, tuple(map(ipaddress.ip_address, addresses)))


class HostStore(CertificateStore):
    """The store of a host; the test may change its `now` and `here`."""

    def __init__(self, folder: Path, *addresses: str, now: datetime.datetime = TODAY) -> None:
        super().__init__(folder, lambda: self.now, lambda: self.here)
        self.now = now
        self.here = reachable(*(addresses or ("192.168.1.20",)))


def client_context(root: bytes | None) -> ssl.SSLContext:
    """A client's context that trusts one root, in PEM, and none of the system's; with None it trusts nobody."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.verify_flags |= ssl.VERIFY_X509_STRICT
    if root is not None:
        context.load_verify_locations(cadata=root.decode())
    return context


def handshake(server: ssl.SSLContext, client: ssl.SSLContext, host: str) -> ssl.SSLObject:
    """Connect both in memory; returns the client's side. Raises ssl.SSLError where the client refuses the server."""
    to_server, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
    one = client.wrap_bio(to_client, to_server, server_hostname=host)
    other = server.wrap_bio(to_server, to_client, server_side=True)
    for _ in range(8):
        done = True
        for side in (one, other):
            try:
                side.do_handshake()
            except ssl.SSLWantReadError:
                done = False
        if done:
            return one
    raise AssertionError("the handshake has no end")
