"""Finds out which process listens on a port that the console needs."""

from __future__ import annotations

import errno
import socket

import psutil


class PortInUse(OSError):
    """A port is in use; the text names its owner."""


def check_free(host: str, port: int) -> None:
    """Raise PortInUse if another process listens on the port of an address; an empty host means all addresses.

    Raises OSError if this computer has no such address.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family) as sock:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            sock.bind((host, port))
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise
            raise PortInUse(f"port {port} is in use by {owner_of(port)}") from error


def owner_of(port: int) -> str:
    """Describe the process that listens on a TCP port, as far as this user may see it."""
    try:
        pids = [
            c.pid for c in psutil.net_connections("tcp") if c.status == psutil.CONN_LISTEN and c.laddr[1:] == (port,) and c.pid
        ]
        return f"process {pids[0]} ({psutil.Process(pids[0]).name()})" if pids else "another user's process"
    except psutil.Error:
        return "another process"
