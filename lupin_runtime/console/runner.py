"""Runs the HTTP servers of the console."""

from __future__ import annotations

from aiohttp import web

from lupin_runtime.console.socket_closing import close_sockets


class Runner(web.AppRunner):
    """A runner whose connections are closed after `cleanup`."""

    async def cleanup(self) -> None:
        """Stop listening, end all handlers, and close all connections."""
        connections = self.server.connections if self.server is not None else []
        transports = [connection.transport for connection in connections]
        sockets = [transport.get_extra_info("socket") for transport in transports if transport is not None]
        await super().cleanup()
        await close_sockets([each for each in sockets if each is not None])
