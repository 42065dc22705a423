"""Opens the console's listening sockets: "localhost" may resolve to 127.0.0.1 or ::1 (RFC 6761, 6.3), so both are served."""

from __future__ import annotations

import errno
import socket

BACKLOG = 128
_LOOPBACK = "127.0.0.1"
_LOOPBACK_NAMES = (_LOOPBACK, "localhost")
_NO_IPV6 = (errno.EADDRNOTAVAIL, errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT)
_FREE_PORT_TRIES = 20


def listen(host: str, port: int) -> list[socket.socket]:
    """Listen on `host`, on one port; port 0 is any free one, and an empty host means all addresses.

    127.0.0.1 and localhost include ::1 where this computer has it. Raises OSError if an address does not exist, or its port is
    in use: of ::1, too, since another program's clients would come here else, or the other way round.
    """
    if not host:
        dual = socket.has_dualstack_ipv6()
        family = socket.AF_INET6 if dual else socket.AF_INET
        return [socket.create_server(("", port), family=family, backlog=BACKLOG, dualstack_ipv6=dual)]
    if host not in _LOOPBACK_NAMES:
        return [_listen(socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0], host, port)]
    for tries_left in range(_FREE_PORT_TRIES if port == 0 else 1, 0, -1):
        first = _listen(socket.AF_INET, _LOOPBACK, port)
        try:
            return [first, _listen(socket.AF_INET6, "::1", first.getsockname()[1])]
        except OSError as error:
            if error.errno in _NO_IPV6:
                return [first]
            first.close()
            if tries_left == 1 or error.errno != errno.EADDRINUSE:
                raise
    raise AssertionError("the last try returns or raises")


def _listen(family: int, host: str, port: int) -> socket.socket:
    return socket.create_server((host, port), family=family, backlog=BACKLOG)
