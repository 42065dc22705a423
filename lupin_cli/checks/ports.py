"""Ports that Lupin or its clock server needs, held by something else."""

from __future__ import annotations

from collections.abc import Iterator

from lupin_cli.checks.base import Check, Evidence, Finding, Fix, Severity
from lupin_cli.facts.sockets import SOCKETS, Socket
from lupin_cli.quick_dataclass import dataclass


@dataclass(frozen=True)
class Reserved:
    """A port of the laptop, what it is for, and words in the command line or name of its rightful owner."""

    protocol: str
    port: int
    purpose: str
    owners: tuple[str, ...]


RESERVED = (
    Reserved("tcp", 8090, "the operator's page", ("lupin",)),
    Reserved("tcp", 9090, "the page's way into the graph (rosbridge)", ("lupin",)),
    Reserved("udp", 123, "the clock that the robot follows", ("chronyd",)),
)


def find_taken(evidence: Evidence) -> Iterator[Finding]:
    """Ports of this machine that another program holds. Owners that this user may not see are left alone."""
    sockets = evidence.laptop.get(SOCKETS)
    for reserved in RESERVED if sockets is not None else ():
        for socket in sockets.on(reserved.protocol, reserved.port) if sockets else ():
            if socket.pid and not _rightful(socket, reserved):
                yield Finding(
                    id=f"port-{reserved.port}-taken",
                    severity=Severity.PROBLEM,
                    where="laptop",
                    symptom=f"{reserved.purpose} does not come up: Address already in use",
                    cause=f"{socket.process} (process {socket.pid}) holds {reserved.protocol.upper()} {reserved.port}",
                    evidence=(socket.line(), socket.command),
                    fix=Fix(f"kill {socket.pid}"),
                )
                break


def _rightful(socket: Socket, reserved: Reserved) -> bool:
    return any(owner in socket.process or owner in socket.command for owner in reserved.owners)


CHECKS = (Check("ports", find_taken, laptop=(SOCKETS,)),)
