"""Waits until the event loop has closed the sockets of connections that ended.

Over TLS, aiohttp leaves that to the loop: it waits until the other end has answered the end of TLS, and often longer than the
loop runs.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
from asyncio.trsock import TransportSocket
from collections.abc import Collection

_CLOSE_TIMEOUT_S = 1.0


async def close_sockets(sockets: Collection[socket.socket | TransportSocket]) -> None:
    """End connections both ways, and wait until the event loop has closed them, but at most 1 s."""
    for each in sockets:
        with contextlib.suppress(OSError):  # closed already
            each.shutdown(socket.SHUT_RDWR)
    with contextlib.suppress(asyncio.TimeoutError):
        await asyncio.wait_for(_wait_until_closed(sockets), _CLOSE_TIMEOUT_S)


async def _wait_until_closed(sockets: Collection[socket.socket | TransportSocket]) -> None:
    while any(each.fileno() != -1 for each in sockets):
        await asyncio.sleep(0.001)
