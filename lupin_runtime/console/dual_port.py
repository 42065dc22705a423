"""Serves HTTPS and HTTP on one port: the first byte of a connection shows which of the two the client speaks.

A browser in which somebody types `http://robot:8090` then gets an answer, and can be redirected to HTTPS.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import ipaddress
import socket
import ssl
from collections.abc import Callable
from typing import Any

from lupin_runtime.console.listeners import listen

_TLS_HANDSHAKE = 0x16  # the type of a TLS record that begins a connection
_FIRST_BYTE_TIMEOUT_S = 10.0
# Connections that have sent nothing yet, or have not completed the TLS handshake: beyond these numbers the oldest is closed, so
# that silent connections keep nobody out. Those from this computer itself do not count towards the total.
_MAX_UNDECIDED = 128
_MAX_UNDECIDED_PER_ADDRESS = 16
# A client that opens connections without end only keeps out other clients of its own address. This computer has no limit.
_MAX_PER_ADDRESS = 128


class DualPort:
    """Accepts connections on listening sockets and gives each to `factory`, over TLS if the client begins with TLS.

    If `tls` is None, every connection is plain.
    """

    def __init__(self, factory: Callable[[], asyncio.BaseProtocol], tls: ssl.SSLContext | None) -> None:
        self._factory = factory
        self._tls = tls
        self._sockets: list[socket.socket] = []
        self._is_closed = False
        self._deciding: set[asyncio.Task[None]] = set()
        self._undecided: dict[str, dict[asyncio.Task[None], socket.socket]] = {}  # by address, the oldest first
        self._open: dict[str, list[asyncio.BaseTransport]] = {}  # by address: those that count towards its limit

    def open(self, host: str, port: int) -> int:
        """Listen on `host`, or on all addresses if it is empty (see `listen`); returns the port. Raises OSError."""
        opened = listen(host, port)
        for listener in opened:
            listener.setblocking(False)
            self._sockets.append(listener)
            self._accept_from(listener)
        return int(opened[0].getsockname()[1])

    def use(self, tls: ssl.SSLContext) -> None:
        """Use another TLS context for new connections."""
        self._tls = tls

    def exempt(self, transport: asyncio.BaseTransport) -> None:
        """No longer count a connection towards its address's limit, because it belongs to a paired browser."""
        for transports in self._open.values():
            if transport in transports:
                transports.remove(transport)
                return

    async def close(self) -> None:
        """Stop listening; connections that were given to the factory stay open."""
        self._is_closed = True
        for listener in self._sockets:
            asyncio.get_running_loop().remove_reader(listener)
            listener.close()
        for waiting in self._undecided.values():
            for connection in waiting.values():
                _end(connection)
        await asyncio.gather(*self._deciding, return_exceptions=True)

    def _accept_from(self, listener: socket.socket) -> None:
        if not self._is_closed:
            asyncio.get_running_loop().add_reader(listener, self._accept, listener)

    def _accept(self, listener: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        try:
            connection, address = listener.accept()
        except (BlockingIOError, InterruptedError, ConnectionAbortedError):
            return  # the client has given up
        except OSError:
            loop.remove_reader(listener)
            loop.call_later(0.1, self._accept_from, listener)  # too many open files; existing connections go on
            return
        host = address[0]
        if self._count_open(host) >= _MAX_PER_ADDRESS:
            connection.close()
            return
        self._make_room(host)
        task = loop.create_task(self._decide(connection, host))
        self._deciding.add(task)
        self._undecided.setdefault(host, {})[task] = connection
        task.add_done_callback(self._deciding.discard)
        task.add_done_callback(functools.partial(self._forget, host))

    def _make_room(self, address: str) -> None:
        """Close the oldest undecided connection of an address if it has too many, or else of the one that has most of them."""
        if len(self._undecided.get(address, ())) >= (_MAX_UNDECIDED if _is_loopback(address) else _MAX_UNDECIDED_PER_ADDRESS):
            self._close_oldest(address)
        others = {each: len(waiting) for each, waiting in self._undecided.items() if not _is_loopback(each)}
        if sum(others.values()) >= _MAX_UNDECIDED:
            self._close_oldest(max(others, key=others.__getitem__))

    def _close_oldest(self, address: str) -> None:
        task, connection = next(iter(self._undecided[address].items()))
        _end(connection)
        self._forget(address, task)

    def _forget(self, address: str, task: asyncio.Task[None]) -> None:
        waiting = self._undecided.get(address, {})
        waiting.pop(task, None)
        if not waiting:
            self._undecided.pop(address, None)

    def _count_open(self, address: str) -> int:
        """Return how many connections of an address are open."""
        transports = [transport for transport in self._open.pop(address, []) if not transport.is_closing()]
        if transports:
            self._open[address] = transports
        return len(transports)

    async def _decide(self, connection: socket.socket, address: str) -> None:
        loop = asyncio.get_running_loop()
        connection.setblocking(False)
        options: dict[str, Any] = {}
        try:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            if (
                self._tls is not None
                and await asyncio.wait_for(_peek_first_byte(connection), _FIRST_BYTE_TIMEOUT_S) == _TLS_HANDSHAKE
            ):
                options = {"ssl": self._tls, "ssl_handshake_timeout": _FIRST_BYTE_TIMEOUT_S}
        except (OSError, asyncio.TimeoutError):
            connection.close()
            return
        with contextlib.suppress(OSError):  # the handshake fails if the client does not trust the certificate
            transport, _ = await loop.connect_accepted_socket(self._factory, connection, **options)
            if not _is_loopback(address):
                self._open.setdefault(address, []).append(transport)


def _end(connection: socket.socket) -> None:
    """Shut a connection down: the wait for its first byte, or its TLS handshake, fails then, and closes it."""
    with contextlib.suppress(OSError):  # the client has ended it already
        connection.shutdown(socket.SHUT_RDWR)


def _is_loopback(address: str) -> bool:
    return ipaddress.ip_address(address.removeprefix("::ffff:").split("%", 1)[0]).is_loopback


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
