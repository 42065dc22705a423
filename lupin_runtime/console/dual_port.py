"""Serves HTTPS and HTTP on one port: the first byte of a connection shows which of the two the client speaks.

A browser in which somebody types `http://robot:8090` then gets an answer, and can be redirected to HTTPS.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
import ssl
from collections.abc import Callable
from typing import Any

_TLS_HANDSHAKE = 0x16  # the type of a TLS record that begins a connection
_FIRST_BYTE_TIMEOUT_S = 10.0
_MAX_UNDECIDED = 128  # connections that have sent nothing yet
# A client that opens connections without end only keeps out other clients of its own address.
_MAX_PER_ADDRESS = 128


class DualPort:
    """Accepts connections on listening sockets and gives each to `factory`, over TLS if the client begins with TLS.

    If `tls` is None, every connection is plain.
    """

    def __init__(self, factory: Callable[[], asyncio.BaseProtocol], tls: ssl.SSLContext | None) -> None:
        self._factory = factory
        self._tls = tls
        self._sockets: list[socket.socket] = []
        self._accepting: list[asyncio.Task[None]] = []
        self._undecided: set[asyncio.Task[None]] = set()
        self._open: dict[str, list[asyncio.BaseTransport]] = {}

    def open(self, host: str, port: int) -> int:
        """Listen on `host`, or on all addresses if it is empty; returns the port. Raises OSError."""
        if host:
            family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
            listener = socket.create_server((host, port), family=family, backlog=128)
        elif socket.has_dualstack_ipv6():
            listener = socket.create_server(("", port), family=socket.AF_INET6, backlog=128, dualstack_ipv6=True)
        else:
            listener = socket.create_server(("", port), backlog=128)
        listener.setblocking(False)
        self._sockets.append(listener)
        self._accepting.append(asyncio.get_running_loop().create_task(self._accept(listener)))
        return int(listener.getsockname()[1])

    def use(self, tls: ssl.SSLContext) -> None:
        """Use another TLS context for new connections."""
        self._tls = tls

    async def close(self) -> None:
        """Stop listening; connections that were given to the factory stay open."""
        for task in (*self._accepting, *self._undecided):
            task.cancel()
        await asyncio.gather(*self._accepting, *self._undecided, return_exceptions=True)
        for listener in self._sockets:
            listener.close()

    async def _accept(self, listener: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        while True:
            try:
                connection, address = await loop.sock_accept(listener)
            except OSError:
                await asyncio.sleep(0.1)  # too many open files; existing connections go on
                continue
            if len(self._undecided) >= _MAX_UNDECIDED or self._count_open(address[0]) >= _MAX_PER_ADDRESS:
                connection.close()
                continue
            task = loop.create_task(self._decide(connection, address[0]))
            self._undecided.add(task)
            task.add_done_callback(self._undecided.discard)

    def _count_open(self, address: str) -> int:
        """Return how many connections of an address are open."""
        transports = [transport for transport in self._open.pop(address, []) if not transport.is_closing()]
        if transports:
            self._open[address] = transports
        return len(transports)

    async def _decide(self, connection: socket.socket, address: str) -> None:
        loop = asyncio.get_running_loop()
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        try:
            options: dict[str, Any] = {}
            if (
                self._tls is not None
                and await asyncio.wait_for(_peek_first_byte(connection), _FIRST_BYTE_TIMEOUT_S) == _TLS_HANDSHAKE
            ):
                options = {"ssl": self._tls, "ssl_handshake_timeout": _FIRST_BYTE_TIMEOUT_S}
            with contextlib.suppress(OSError):  # the handshake fails if the client does not trust the certificate
                transport, _ = await loop.connect_accepted_socket(self._factory, connection, **options)
                self._open.setdefault(address, []).append(transport)
        except (OSError, asyncio.TimeoutError):
            connection.close()
        except asyncio.CancelledError:
            connection.close()
            raise


async def _peek_first_byte(connection: socket.socket) -> int:
    """Return the first byte that a client sends, without consuming it. Raises ConnectionError if it sends none."""
    loop = asyncio.get_running_loop()
    readable = asyncio.Event()
    loop.add_reader(connection, readable.set)
    try:
        await readable.wait()
    finally:
        loop.remove_reader(connection)
    data = connection.recv(1, socket.MSG_PEEK)
    if not data:
        raise ConnectionResetError("the connection was closed before its first byte")
    return data[0]
