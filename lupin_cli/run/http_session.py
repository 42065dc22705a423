"""The HTTP session of this computer with a console."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import AsyncIterator
from typing import TYPE_CHECKING, Any

from lupin_runtime.console.socket_closing import close_sockets

if TYPE_CHECKING:
    from aiohttp import ClientSession


@contextlib.asynccontextmanager
async def open_session(**options: Any) -> AsyncIterator[ClientSession]:
    """Open a session that stores no cookies; all its connections are closed when it ends.

    `options` are those of aiohttp.ClientSession.
    """
    import aiohttp

    opened: list[socket.socket] = []

    def open_socket(address: tuple[Any, ...]) -> socket.socket:
        opened.append(socket.socket(*address[:3]))
        return opened[-1]

    connector = aiohttp.TCPConnector(socket_factory=open_socket)
    try:
        async with aiohttp.ClientSession(connector=connector, cookie_jar=aiohttp.DummyCookieJar(), **options) as session:
            yield session
    finally:
        await close_sockets(opened)
