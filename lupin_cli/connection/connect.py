"""Connect a socket to an sshd and wait for its answer. Each kind of failure has a name, because it has its own causes."""

from __future__ import annotations

import errno
import queue
import socket
import threading
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from lupin_cli.connection.base import Unreachable
from lupin_cli.connection.destination import Destination, parse_destination

# "No route to host" shows that the laptop has lost the network, a timeout that the robot has.
_KINDS = {
    errno.EHOSTUNREACH: "no-route",
    errno.ENETUNREACH: "no-route",
    errno.ENETDOWN: "no-route",
    errno.EADDRNOTAVAIL: "no-route",
    errno.ECONNREFUSED: "refused",
    errno.ECONNRESET: "lost",  # accepted, and reset before connect() returned
    errno.ETIMEDOUT: "timeout",
}
_MOST_TELLING_FIRST = ("lost", "refused", "no-route", "timeout")  # which failure to report if a name has several addresses

_BETTER_RANK_GRACE_S = 0.3  # how long to wait for a better-ranked address after a worse one has answered
CONNECT_TIMEOUT_S = 5.0
UNACKNOWLEDGED_MS = 10_000  # a laptop may take this long to roam between access points

_MEANING = {
    "no-route": "this machine has no route to that address: it has lost the robot's network",
    "refused": "the machine answers, but no sshd listens on that port",
    "timeout": "nothing answers at that address",
    "silent": "it accepts connections but does not answer: its sshd hangs",
    "name": "that name has no address",
    "lost": "the connection was lost",
}


def unreachable(destination: str, kind: str, detail: str = "") -> Unreachable:
    """Return the error for `kind`, with the command that examines it."""
    host = parse_destination(destination)[1]
    commands = {
        "no-route": f"ip route get {host}",
        "timeout": f"ping -c 3 {host}",
        "refused": f"ping -c 3 {host}",
        "name": "lupin robots list",
    }
    message = f"{destination}: {_MEANING[kind]}" + (f" ({detail})" if detail else "")
    return Unreachable(message, kind, commands.get(kind, "lupin doctor"))


def open_socket(destination: Destination, timeout_s: float) -> socket.socket:
    """Return a connected socket that does not use Nagle's algorithm and notices a dead link. Raises Unreachable."""
    deadline = time.monotonic() + timeout_s
    failures: dict[str, str] = {}
    for family, address in _addresses(destination, timeout_s):
        connection = socket.socket(family, socket.SOCK_STREAM)
        try:
            connection.settimeout(max(0.1, deadline - time.monotonic()))
            connection.connect(address)
        except OSError as error:
            connection.close()
            kind = "timeout" if isinstance(error, TimeoutError) else _KINDS.get(error.errno or 0, "no-route")
            failures[kind] = error.strerror or f"no answer within {timeout_s:g} s"
            continue
        # Nagle's algorithm holds each small packet back until the previous one is acknowledged: 44 ms a command instead of 2.
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, UNACKNOWLEDGED_MS)
        return connection
    kind = next(kind for kind in _MOST_TELLING_FIRST if kind in failures)
    raise unreachable(str(destination), kind, failures[kind])


def open_with_banner(destination: Destination, timeout_s: float) -> socket.socket:
    """Return a connected socket on which the server's banner has begun to arrive; it is left unread. Raises Unreachable."""
    connection = open_socket(destination, timeout_s)
    try:
        _await_banner(connection, timeout_s, str(destination))
    except BaseException:
        connection.close()
        raise
    return connection


def first_reachable(choices: Mapping[str, Destination], timeout_s: float = 3.0) -> str:
    """Return the transport to use: the best-ranked one (the first is best) on which something accepts a connection.

    All are tried at the same time. Once one answers, better-ranked ones get `_BETTER_RANK_GRACE_S` to answer too. If none
    answers, return the first, so that connecting to it reports the reason. Destinations behind a jump host or proxy command
    are not tried, because a trial costs a whole connection.
    """
    first = next(iter(choices))
    if len(choices) == 1 or any(destination.jumps or destination.proxy_command for destination in choices.values()):
        return first
    attempts: queue.Queue[tuple[str, bool]] = queue.Queue()

    def attempt(transport: str, destination: Destination) -> None:
        attempts.put((transport, _accepts_connections(destination, timeout_s)))

    for transport, destination in choices.items():
        threading.Thread(target=attempt, args=(transport, destination), name=f"try-{transport}", daemon=True).start()
    reachable: dict[str, bool] = {}
    deadline = time.monotonic() + timeout_s
    # The best transport that has not failed: done once it has answered.
    while (best := next((name for name in choices if reachable.get(name, True)), None)) and best not in reachable:
        try:
            transport, answered = attempts.get(timeout=max(0.0, deadline - time.monotonic()))
        except queue.Empty:
            break
        reachable[transport] = answered
        if answered:
            deadline = min(deadline, time.monotonic() + _BETTER_RANK_GRACE_S)
    return next((name for name in choices if reachable.get(name)), first)


def reachability(choices: Mapping[str, Destination], timeout_s: float = 3.0) -> dict[str, bool]:
    """Return whether each destination accepts connections; one behind a jump host or a proxy command is assumed to."""

    def is_reachable(destination: Destination) -> bool:
        if destination.jumps or destination.proxy_command:
            return True
        return _accepts_connections(destination, timeout_s)

    with ThreadPoolExecutor(max_workers=max(1, len(choices)), thread_name_prefix="try") as pool:
        return dict(zip(choices, pool.map(is_reachable, choices.values())))


def _accepts_connections(destination: Destination, timeout_s: float) -> bool:
    try:
        open_socket(destination, timeout_s).close()
    except Unreachable:
        return False
    return True


def _await_banner(connection: socket.socket, timeout_s: float, destination: str) -> None:
    connection.settimeout(timeout_s)
    try:
        first = connection.recv(1, socket.MSG_PEEK)
    except TimeoutError:
        raise unreachable(destination, "silent", f"no SSH banner within {timeout_s:g} s") from None
    except OSError as error:
        raise unreachable(
            destination, "lost", f"{error.strerror} before its SSH banner: it is booting or shutting down"
        ) from error
    if not first:
        detail = "it closed the connection before its SSH banner: it is booting or shutting down, or refuses this machine"
        raise unreachable(destination, "lost", detail)


def _addresses(destination: Destination, timeout_s: float) -> list[tuple[int, Any]]:
    """Resolve the host. The resolver has no timeout, so it runs on a thread that may be left behind."""
    answers: queue.Queue[list[tuple[int, Any]] | OSError] = queue.Queue()

    def resolve() -> None:
        try:
            found = socket.getaddrinfo(destination.host, destination.port, type=socket.SOCK_STREAM)
        except OSError as error:
            answers.put(error)
        else:
            answers.put([(family, address) for family, _, _, _, address in found])

    threading.Thread(target=resolve, name="lupin-resolver", daemon=True).start()
    try:
        answer = answers.get(timeout=timeout_s)
    except queue.Empty:
        raise unreachable(str(destination), "name", f"no answer from the name server within {timeout_s:g} s") from None
    if isinstance(answer, OSError):
        raise unreachable(str(destination), "name", answer.strerror or str(answer)) from answer
    return answer
