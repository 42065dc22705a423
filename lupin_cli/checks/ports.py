"""Ports that Lupin or its NTP server needs, held by another program."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from lupin_cli.checks.base import Check, Finding, Snapshot
from lupin_cli.checks.findings import make_finding
from lupin_cli.checks.remote_command import command_on
from lupin_cli.facts.base import Facts
from lupin_cli.facts.sockets import SOCKETS, Socket
from lupin_cli.facts.units import UNIT_STATES
from lupin_cli.systemd.units import CAMERAS
from lupin_runtime.ports import CONSOLE_PORT, ROSBRIDGE_PORT, VIDEO_PORT


@dataclass(frozen=True)
class ReservedPort:
    """A port, the finding if it is taken, and a pattern that is found in the name and command line of its owner."""

    finding: str
    protocol: str
    port: int
    owner: re.Pattern[str]


# One of Lupin's programs, in whatever folder it is installed; a folder of that name makes no other program Lupin's.
_LUPIN = re.compile(r"^lupin\b| -m lupin_\w|^\S+( -\S+)* \S*/bin/lupin( |$)")
_CHRONY = re.compile(r"^chronyd\b")

LAPTOP_PORTS = (
    ReservedPort("port-8090-taken", "tcp", CONSOLE_PORT, _LUPIN),  # the operator's page
    ReservedPort("port-9090-taken", "tcp", ROSBRIDGE_PORT, _LUPIN),  # rosbridge, over which the page reaches the graph
    ReservedPort("port-123-taken", "udp", 123, _CHRONY),  # the clock that the robot follows
)
ROBOT_PORTS = (ReservedPort("port-8091-taken", "tcp", VIDEO_PORT, _LUPIN),)  # the cameras' images


def find_taken_ports(snapshot: Snapshot) -> Iterator[Finding]:
    """Another program holds a port. A process that this user may not see is not reported."""
    yield from _find_taken(snapshot, snapshot.laptop, LAPTOP_PORTS)
    units = snapshot.robot_fact(UNIT_STATES)
    if snapshot.robot is not None and units is not None and units.get(CAMERAS):
        yield from _find_taken(snapshot, snapshot.robot, ROBOT_PORTS)


def _find_taken(snapshot: Snapshot, facts: Facts, ports: tuple[ReservedPort, ...]) -> Iterator[Finding]:
    sockets = facts.get(SOCKETS)
    if sockets is None:
        return
    on_robot = facts.machine == "robot"
    for reserved in ports:
        for socket in sockets.on(reserved.protocol, reserved.port):
            if socket.pid and not _is_owner(socket, reserved):
                yield make_finding(
                    reserved.finding,
                    where=facts.machine,
                    cause=f"{socket.process} (process {socket.pid}) holds {reserved.protocol.upper()} {reserved.port}",
                    evidence=(socket.line(), socket.command),
                    command=command_on(snapshot, facts.machine, f"{'sudo ' if on_robot else ''}kill {socket.pid}"),
                    explains={f"unit-restarting:{CAMERAS}", f"unit-failed:{CAMERAS}"} if on_robot else (),
                )
                break


def _is_owner(socket: Socket, reserved: ReservedPort) -> bool:
    return any(reserved.owner.search(text) for text in (socket.process, socket.command))


CHECKS = (Check("ports", find_taken_ports, laptop=(SOCKETS,), robot=(SOCKETS, UNIT_STATES)),)
