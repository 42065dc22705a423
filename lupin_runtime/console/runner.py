"""Runs the HTTP servers of the console."""

from __future__ import annotations

import asyncio

from aiohttp import web


class Runner(web.AppRunner):
    """A runner whose connections are closed after `cleanup`.

    Those over TLS would otherwise stay open until the client has answered their end, and the event loop may end before.
    """

    async def cleanup(self) -> None:
        """Stop listening, end all handlers, and close all connections."""
        server = self.server
        connections = server.connections if server is not None else []
        transports = [connection.transport for connection in connections]
        await super().cleanup()
        for transport in transports:
            if isinstance(transport, asyncio.Transport):
                transport.abort()
        await asyncio.sleep(0)  # the event loop closes what was aborted
