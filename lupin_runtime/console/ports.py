"""Who listens on a port that the console needs."""

from __future__ import annotations

import socket

import psutil


class PortInUse(OSError):
    """The port is taken; the text names its owner."""


def check_free(host: str, port: int) -> None:
    """Raise PortInUse where another process listens on the port."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            raise PortInUse(f"port {port} is in use by {owner_of(port)}") from error


def owner_of(port: int) -> str:
    """The process that listens on a TCP port, as far as this user may know."""
    try:
        pids = [
            c.pid for c in psutil.net_connections("tcp") if c.status == psutil.CONN_LISTEN and c.laddr[1:] == (port,) and c.pid
        ]
        return f"process {pids[0]} ({psutil.Process(pids[0]).name()})" if pids else "another user's process"
    except psutil.Error:
        return "another process"
