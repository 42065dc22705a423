"""One port for HTTPS and HTTP: the first byte of a connection tells which of the two it speaks.

A browser that opens `http://robot:8090` by hand then gets an answer, and can be sent to HTTPS.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
import ssl
from collections.abc import Callable
from typing import Any

_TLS_HANDSHAKE = 0x16  # the type of a TLS record that begins a connection
_FIRST_BYTE_S = 10.0
_MAX_UNDECIDED = 128  # connections that have sent nothing yet
# A client that opens connections and never ends its requests keeps out nobody but other clients of its own address.
_MAX_OF_ADDRESS = 128


class DualPort:
    """Accepts connections on listening sockets and gives each to `factory`, over TLS where it begins with TLS.

    With `tls` None every connection is plain.
    """

    def __init__(self, factory: Callable[[], asyncio.BaseProtocol], tls: ssl.SSLContext | None) -> None:
        self._factory = factory
        self._tls = tls
        self._sockets: list[socket.socket] = []
        self._accepting: list[asyncio.Task[None]] = []
        self._undecided: set[asyncio.Task[None]] = set()
        self._open: dict[str, list[asyncio.BaseTransport]] = {}

    def open(self, host: str, port: int) -> int:
        """Listen on an address, or on all of them where it is empty; returns the port. Raises OSError."""
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
        """Use a renewed certificate for connections from now on."""
        self._tls = tls

    async def close(self) -> None:
        """Stop listening; connections that were given to the factory go on."""
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
                await asyncio.sleep(0.1)  # too many open files: those who are connected go on
                continue
            if len(self._undecided) >= _MAX_UNDECIDED or self._count(address[0]) >= _MAX_OF_ADDRESS:
                connection.close()
                continue
            task = loop.create_task(self._decide(connection, address[0]))
            self._undecided.add(task)
            task.add_done_callback(self._undecided.discard)

    def _count(self, address: str) -> int:
        """The connections of an address that are open."""
        is_open = [transport for transport in self._open.pop(address, []) if not transport.is_closing()]
        if is_open:
            self._open[address] = is_open
        return len(is_open)

    async def _decide(self, connection: socket.socket, address: str) -> None:
        loop = asyncio.get_running_loop()
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        try:
            options: dict[str, Any] = {}
            if self._tls is not None and await asyncio.wait_for(_first_byte(connection), _FIRST_BYTE_S) == _TLS_HANDSHAKE:
                options = {"ssl": self._tls, "ssl_handshake_timeout": _FIRST_BYTE_S}
            with contextlib.suppress(OSError):  # a handshake that fails: the client does not trust the certificate
                transport, _ = await loop.connect_accepted_socket(self._factory, connection, **options)
                self._open.setdefault(address, []).append(transport)
        except (OSError, asyncio.TimeoutError):
            connection.close()
        except asyncio.CancelledError:
            connection.close()
            raise


async def _first_byte(connection: socket.socket) -> int:
    """The first byte that a client sends, which stays to be read. Raises ConnectionError where it leaves without one."""
    loop = asyncio.get_running_loop()
    readable = asyncio.Event()
    loop.add_reader(connection, readable.set)
    try:
        await readable.wait()
    finally:
        loop.remove_reader(connection)
    data = connection.recv(1, socket.MSG_PEEK)
    if not data:
        raise ConnectionResetError("closed before its first byte")
    return data[0]
