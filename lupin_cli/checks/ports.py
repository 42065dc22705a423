"""Ports of the laptop that Lupin or its NTP server needs, held by another program."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from lupin_cli.checks.base import Check, Finding, Snapshot
from lupin_cli.checks.findings import make_finding
from lupin_cli.facts.sockets import SOCKETS, Socket


@dataclass(frozen=True)
class ReservedPort:
    """A port of the laptop, the finding if it is taken, and a word in the name or command line of its owner."""

    finding: str
    protocol: str
    port: int
    owner: str


RESERVED = (
    ReservedPort("port-8090-taken", "tcp", 8090, "lupin"),  # the operator's page
    ReservedPort("port-9090-taken", "tcp", 9090, "lupin"),  # rosbridge, over which the page reaches the graph
    ReservedPort("port-123-taken", "udp", 123, "chronyd"),  # the clock that the robot follows
)


def find_taken_ports(snapshot: Snapshot) -> Iterator[Finding]:
    """Another program holds a port of the laptop. A process that this user may not see is not reported."""
    sockets = snapshot.laptop.get(SOCKETS)
    if sockets is None:
        return
    for reserved in RESERVED:
        for socket in sockets.on(reserved.protocol, reserved.port):
            if socket.pid and not _is_owner(socket, reserved):
                yield make_finding(
                    reserved.finding,
                    where="laptop",
                    cause=f"{socket.process} (process {socket.pid}) holds {reserved.protocol.upper()} {reserved.port}",
                    evidence=(socket.line(), socket.command),
                    command=f"kill {socket.pid}",
                )
                break


def _is_owner(socket: Socket, reserved: ReservedPort) -> bool:
    return reserved.owner in socket.process or reserved.owner in socket.command


CHECKS = (Check("ports", find_taken_ports, laptop=(SOCKETS,)),)
