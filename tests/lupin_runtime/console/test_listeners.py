"""The console answers on every address that the names it prints may resolve to."""

from __future__ import annotations

import errno
import socket
from collections.abc import Iterator

import pytest

from lupin_runtime.console.listeners import listen


def has_ipv6_loopback() -> bool:
    try:
        socket.create_server(("::1", 0), family=socket.AF_INET6).close()
    except OSError:
        return False
    return True


needs_ipv6 = pytest.mark.skipif(not has_ipv6_loopback(), reason="this computer has no ::1")


@pytest.fixture
def opened() -> Iterator[list[socket.socket]]:
    sockets: list[socket.socket] = []
    yield sockets
    for each in sockets:
        each.close()


def addresses(sockets: list[socket.socket]) -> set[str]:
    return {each.getsockname()[0] for each in sockets}


# RFC 6761, 6.3: localhost is the loopback address of IPv4 or IPv6; programs try either first.
@needs_ipv6
@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", ""])
def test_localhost_answers_over_both_protocols(opened: list[socket.socket], host: str) -> None:
    opened += listen(host, 0)
    port = opened[0].getsockname()[1]
    for address in ("127.0.0.1", "::1"):
        socket.create_connection((address, port), timeout=60).close()
    if host:
        assert addresses(opened) == {"127.0.0.1", "::1"}


@needs_ipv6
def test_other_address_is_served_alone(opened: list[socket.socket]) -> None:
    opened += listen("::1", 0)
    assert addresses(opened) == {"::1"}


def test_computer_without_ipv6_serves_127_0_0_1(opened: list[socket.socket], monkeypatch: pytest.MonkeyPatch) -> None:
    create = socket.create_server

    def create_without_ipv6(address: tuple[str, int], *, family: int, backlog: int) -> socket.socket:
        if family == socket.AF_INET6:
            raise OSError(errno.EADDRNOTAVAIL, "Cannot assign requested address")
        return create(address, family=family, backlog=backlog)

    monkeypatch.setattr(socket, "create_server", create_without_ipv6)
    opened += listen("localhost", 0)
    assert addresses(opened) == {"127.0.0.1"}


@needs_ipv6
@pytest.mark.parametrize("taken", ["127.0.0.1", "::1"])
def test_port_that_is_taken_on_either_address_is_refused(opened: list[socket.socket], taken: str) -> None:
    opened.append(socket.create_server((taken, 0), family=socket.AF_INET6 if ":" in taken else socket.AF_INET))
    port = opened[0].getsockname()[1]
    with pytest.raises(OSError, match="in use") as refused:
        listen("localhost", port)
    assert refused.value.errno == errno.EADDRINUSE
    socket.create_connection((taken, port), timeout=60).close()  # the other address was let go
    free = "127.0.0.1" if ":" in taken else "::1"
    opened.append(socket.create_server((free, port), family=socket.AF_INET6 if ":" in free else socket.AF_INET))
