"""The `Port` readiness against real sockets."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import pytest

from lupin_runtime.stack.readiness import Port


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server


def number_of(server: socket.socket) -> int:
    return int(server.getsockname()[1])


def test_port_is_ready_while_a_server_listens(listener: socket.socket) -> None:
    port = Port(number_of(listener))
    assert port.is_listening() and port.is_listening()
    listener.close()
    assert not port.is_listening()


def test_port_is_not_ready_when_it_is_only_bound() -> None:
    with socket.socket() as bound:
        bound.bind(("127.0.0.1", 0))
        assert not Port(number_of(bound)).is_listening()


def test_port_on_another_address_is_not_ready(listener: socket.socket) -> None:
    assert not Port(number_of(listener), "127.0.0.2").is_listening()


def test_port_accepts_an_ipv6_address() -> None:
    with socket.create_server(("::1", 0), family=socket.AF_INET6) as server:
        assert Port(number_of(server), "::1").is_listening()


def test_port_is_named_by_address_and_number() -> None:
    assert str(Port(8090)) == "port 127.0.0.1:8090"


@pytest.mark.usefixtures("private_graph")
@pytest.mark.graph
def test_monitor_waits_for_a_port_and_forgets_it(listener: socket.socket) -> None:
    from lupin_runtime.stack.graph_monitor import GraphMonitor

    port, closed = Port(number_of(listener)), Port(1)
    monitor = GraphMonitor(rated=())
    try:
        assert monitor.satisfied(port) and not monitor.satisfied(closed)
        assert monitor.explain(closed) == "port 127.0.0.1:1: nothing listens"
        listener.close()
        assert monitor.satisfied(port)
        monitor.forget(port)
        assert not monitor.satisfied(port)
    finally:
        monitor.close()
