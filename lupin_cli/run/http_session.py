"""The HTTP session of this computer with a console."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from aiohttp import ClientSession

_CLOSE_TIMEOUT_S = 1.0


@contextlib.asynccontextmanager
async def open_session(**options: Any) -> AsyncIterator[ClientSession]:
    """Open a session that stores no cookies; all its connections are closed when it ends.

    Without this, one over TLS that is not kept for another request would stay open until the console has answered its end,
    and the event loop may end before. `options` are those of aiohttp.ClientSession.
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
        for each in opened:
            with contextlib.suppress(OSError):  # closed already
                each.shutdown(socket.SHUT_RDWR)  # the event loop closes it then
        with contextlib.suppress(asyncio.TimeoutError):
            await asyncio.wait_for(_wait_until_closed(opened), _CLOSE_TIMEOUT_S)


async def _wait_until_closed(opened: list[socket.socket]) -> None:
    while any(each.fileno() != -1 for each in opened):
        await asyncio.sleep(0.001)
