"""From an address to a socket on which an sshd has spoken; each way of failing has a word of its own, as it has a cause."""

from __future__ import annotations

import errno
import queue
import socket
import threading
import time
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from lupin_cli.target.base import Unreachable
from lupin_cli.target.destination import Destination

# `No route to host` says that the laptop's own link is gone, a time-out that the robot's is.
_KINDS = {
    errno.EHOSTUNREACH: "no-route",
    errno.ENETUNREACH: "no-route",
    errno.ENETDOWN: "no-route",
    errno.EADDRNOTAVAIL: "no-route",
    errno.ECONNREFUSED: "refused",
    errno.ECONNRESET: "lost",  # accepted, and reset before connect() had looked
    errno.ETIMEDOUT: "timeout",
}
_WORTH = ("lost", "refused", "no-route", "timeout")  # of several addresses, the answer that says most

_HEAD_START_S = 0.3
CONNECT_TIMEOUT_S = 5.0
UNACKNOWLEDGED_MS = 10_000  # as long as a laptop may take to roam and come back

MEANING = {
    "no-route": "there is no way there from here: this machine has lost the robot's network",
    "refused": "the machine answers, but no sshd listens there",
    "timeout": "nothing answers at that address",
    "silent": "it accepts connections and says nothing: its sshd hangs",
    "name": "that name has no address",
    "lost": "the connection was lost",
}


def unreachable(who: str, kind: str, detail: str = "") -> Unreachable:
    """The error for `kind`, with what to look at next."""
    host = who.split("@")[-1]
    commands = {
        "no-route": f"ip route get {host}",
        "timeout": f"ping -c 3 {host}",
        "refused": f"ping -c 3 {host}",
        "name": "lupin robots list",
    }
    message = f"{who}: {MEANING[kind]}" + (f" ({detail})" if detail else "")
    return Unreachable(message, kind, commands.get(kind, "lupin doctor"))


def open_socket(host: str, port: int, timeout_s: float, who: str) -> socket.socket:
    """A connected socket with small packets sent at once, that notices a dead link. Raises Unreachable."""
    deadline = time.monotonic() + timeout_s
    failures: dict[str, str] = {}
    for family, address in _addresses(host, port, timeout_s, who):
        connection = socket.socket(family, socket.SOCK_STREAM)
        try:
            connection.settimeout(max(0.1, deadline - time.monotonic()))
            connection.connect(address)
        except OSError as error:
            connection.close()
            kind = "timeout" if isinstance(error, TimeoutError) else _KINDS.get(error.errno or 0, "no-route")
            failures[kind] = error.strerror or f"no answer within {timeout_s:g} s"
            continue
        # Nagle would hold every small request back until the last is acknowledged: 44 ms a command instead of 2.
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        if hasattr(socket, "TCP_USER_TIMEOUT"):  # Linux: what isn't acknowledged for so long ends the connection
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, UNACKNOWLEDGED_MS)
        return connection
    kind = next(kind for kind in _WORTH if kind in failures)
    raise unreachable(who, kind, failures[kind])


def best_of(choices: Mapping[str, Destination], timeout_s: float = 3.0) -> tuple[str, Destination]:
    """The transport to use: the best ranked (first) of those on which something answers.

    All are tried at once; a better one may come `_HEAD_START_S` later than a worse. Where none answers it is the first, so that
    the attempt which follows says why. A destination behind a jump isn't tried: its answer takes a whole connection.
    """
    if len(choices) == 1 or any(place.jumps or place.proxy_command for place in choices.values()):
        return next(iter(choices.items()))
    results: queue.Queue[tuple[str, bool]] = queue.Queue()

    def attempt(transport: str, place: Destination) -> None:
        try:
            open_socket(place.host, place.port, timeout_s, str(place)).close()
        except Unreachable:
            results.put((transport, False))
        else:
            results.put((transport, True))

    for transport, place in choices.items():
        threading.Thread(target=attempt, args=(transport, place), name=f"try-{transport}", daemon=True).start()
    answers: dict[str, bool] = {}
    deadline = time.monotonic() + timeout_s
    while len(answers) < len(choices):
        try:
            transport, answered = results.get(timeout=max(0.0, deadline - time.monotonic()))
        except queue.Empty:
            break
        answers[transport] = answered
        if answered:
            if all(transport == name or name in answers for name in _up_to(choices, transport)):
                break
            deadline = min(deadline, time.monotonic() + _HEAD_START_S)
    best = next((name for name in choices if answers.get(name)), next(iter(choices)))
    return best, choices[best]


def which_answer(choices: Mapping[str, Destination], timeout_s: float = 3.0) -> dict[str, bool]:
    """Whether something accepts connections at each destination; one behind a jump counts as answering."""

    def answers(place: Destination) -> bool:
        if place.jumps or place.proxy_command:
            return True
        try:
            open_socket(place.host, place.port, timeout_s, str(place)).close()
        except Unreachable:
            return False
        return True

    with ThreadPoolExecutor(max_workers=max(1, len(choices)), thread_name_prefix="try") as pool:
        return dict(zip(choices, pool.map(answers, choices.values())))


def _up_to(choices: Mapping[str, Destination], last: str) -> list[str]:
    names = list(choices)
    return names[: names.index(last) + 1]


def open_greeted(place: Destination, timeout_s: float) -> socket.socket:
    """A connected socket on which the other side has said something, which is left unread. Raises Unreachable."""
    connection = open_socket(place.host, place.port, timeout_s, str(place))
    try:
        _await_banner(connection, timeout_s, str(place))
    except BaseException:
        connection.close()
        raise
    return connection


class Knock:
    """A greeted socket that is opened beside other work: an sshd takes a tenth of a second to come to the door, and so does
    paramiko to be imported."""

    def __init__(self, place: Destination, timeout_s: float = CONNECT_TIMEOUT_S) -> None:
        self._answer: Future[socket.socket] = Future()
        threading.Thread(target=self._open, args=(place, timeout_s), name="knock", daemon=True).start()

    def _open(self, place: Destination, timeout_s: float) -> None:
        try:
            self._answer.set_result(open_greeted(place, timeout_s))
        except BaseException as error:  # raised where it is waited for
            self._answer.set_exception(error)

    def take(self) -> socket.socket:
        """The socket, which is the caller's from now on: a name, a connection and a greeting each take a time-out at most.

        Raises Unreachable.
        """
        return self._answer.result()

    def forget(self) -> None:
        """Whenever it is opened, it is closed."""
        self._answer.add_done_callback(lambda answer: None if answer.exception() else answer.result().close())


def _await_banner(connection: socket.socket, timeout_s: float, who: str) -> None:
    connection.settimeout(timeout_s)
    try:
        first = connection.recv(1, socket.MSG_PEEK)
    except TimeoutError:
        raise unreachable(who, "silent", f"no greeting within {timeout_s:g} s") from None
    except OSError as error:
        raise unreachable(who, "lost", f"{error.strerror} before it greeted: it is going down or coming up") from error
    if not first:
        raise unreachable(who, "lost", "it hung up before it greeted: it is going down or coming up, or turns us away")


def _addresses(host: str, port: int, timeout_s: float, who: str) -> list[tuple[int, Any]]:
    """What the name stands for. The resolver knows no bound, so it is asked on a thread that may be left behind."""
    answers: queue.Queue[list[tuple[int, Any]] | OSError] = queue.Queue()

    def ask() -> None:
        try:
            found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        except OSError as error:
            answers.put(error)
        else:
            answers.put([(family, address) for family, _, _, _, address in found])

    threading.Thread(target=ask, name="lupin-resolver", daemon=True).start()
    try:
        answer = answers.get(timeout=timeout_s)
    except queue.Empty:
        raise unreachable(who, "name", f"no answer from the name server within {timeout_s:g} s") from None
    if isinstance(answer, OSError):
        raise unreachable(who, "name", answer.strerror or str(answer)) from answer
    return answer
