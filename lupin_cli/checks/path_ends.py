"""What the ends of the path show: addresses, routes, neighbors, the carrier, and a robot from which nothing comes."""

from __future__ import annotations

from collections.abc import Iterator

from lupin_cli.checks.base import Finding, Snapshot
from lupin_cli.checks.burst_losses import (
    LOST,
    small_burst,
)
from lupin_cli.checks.findings import OVER_GRAPH, make_finding
from lupin_cli.checks.path_fixes import (
    add_address,
    correct_route,
    own_addresses,
    try_another_transport,
)
from lupin_cli.checks.remote_command import command_on
from lupin_cli.checks.robot_address import is_direct
from lupin_cli.facts.addresses import ADDRESSES
from lupin_cli.link.path import (
    DOWN,
    UP,
    End,
    Path,
)
from lupin_cli.link.path_agent import SILENT

_NO_NEIGHBOR = {"No route to host"}  # what a program gets when nobody answers ARP
ABOVE = OVER_GRAPH | {"robot-unreachable"}


def find_end_faults(snapshot: Snapshot, path: Path) -> Iterator[Finding]:
    """Yield what is wrong with the address or the route of an end; the lower layer if both are."""
    laptop = _address_fault(snapshot, path, path.laptop, path.address) or _route_fault(snapshot, path.laptop, path.address)
    yield from laptop
    if path.robot is not None:
        other = path.laptop.address
        # A laptop that leaves by another interface asks the robot for a way to another address than usual.
        yield from _address_fault(snapshot, path, path.robot, other) or (
            [] if laptop else _route_fault(snapshot, path.robot, other)
        )


def _address_fault(snapshot: Snapshot, path: Path, end: End, other: str) -> list[Finding]:
    """Return a finding if the robot lacks the address in use, or the laptop any address in its network and a route to it."""
    own = own_addresses(snapshot, end.machine)
    if own is None:
        return []
    if end.machine == "robot":
        # Of any scope: it may be link-local. If packets arrive without it, something in between translates.
        addresses = snapshot.robot_fact(ADDRESSES)
        lacks = not (_arrives(path) or (addresses is not None and addresses.has(path.address)))
        what = path.address
    else:
        by_gateway = bool(end.gateway) and (_arrives(path) or not is_direct(snapshot, other))
        lacks = not by_gateway and not any(each.on_same_subnet(other) for each in own)
        lacks = lacks and bool(end.error or end.gateway)
        what = f"an address in the network of {other}, where the other end is"
    if not lacks:
        return []
    return [
        make_finding(
            "address-missing",
            where=end.machine,
            cause=f"no interface of the {end.machine} has {what}",
            evidence=(*(f"{end.machine}: {each.line()}" for each in own), end.line()),
            explains=ABOVE | {"robot-multi-homed"},
            **add_address(snapshot, path, end.machine, other),
        )
    ]


def _arrives(path: Path) -> bool:
    """Return whether anything of the other end has arrived at this one, or the other way round."""
    return bool(path.ping is not None and path.ping.received) or any(burst.arrived or burst.changed for burst in path.bursts)


def _route_fault(snapshot: Snapshot, end: End, other: str) -> list[Finding]:
    """Return a finding if an end has no route to the other one, or one that leaves by an interface of another network."""
    own = own_addresses(snapshot, end.machine) or ()
    if any(each.address == other for each in own):
        return []  # the machine sends to itself, which is a finding of another check
    near = [each for each in own if each.on_same_subnet(other) and each.up and each.carrier]
    if end.error:
        id, cause = "no-route", f"the {end.machine} has no route to {other}, where the other end is"
    else:
        if not near or any(each.interface == end.interface for each in near):
            return []
        id = "route-elsewhere"
        cause = (
            f"packets of the {end.machine} to {other} leave by {end.interface}, "
            f"although {near[0].interface} has the address {near[0].address} of that network"
        )
    return [
        make_finding(
            id,
            where=end.machine,
            cause=cause,
            evidence=(end.line(), *(f"{end.machine}: {line}" for line in (*(each.line() for each in own), *end.routes))),
            explains=ABOVE | {"robot-multi-homed"},
            **correct_route(snapshot, end, other, near),
        )
    ]


def find_wrong_neighbors(snapshot: Snapshot, path: Path) -> Iterator[Finding]:
    """Yield a finding for an end whose packets go to a hardware address that somebody entered, and that is not the other's."""
    for end, other in ((path.laptop, path.robot), (path.robot, path.laptop)):
        if end is None or not end.neighbor:
            continue
        words = end.neighbor[0].split()
        entered = words[words.index("lladdr") + 1] if "lladdr" in words[:-1] else ""
        if (entered == other.hardware) if other is not None and other.hardware else _arrives(path):
            continue
        address = path.address if end.machine == "laptop" else path.laptop.address
        whose = f"; the other end has {other.hardware}" if other is not None and other.hardware else ""
        yield make_finding(
            "neighbor-wrong",
            where=end.machine,
            cause=f"the {end.machine} sends everything for {address} to {entered or 'no device'}, a permanent entry{whose}",
            evidence=(f"ip neigh show to {address}: {end.neighbor[0]}", end.line()),
            command=command_on(snapshot, end.machine, f"sudo ip neigh del {address} dev {end.interface}"),
            explains=ABOVE | {"link-dead", "robot-multi-homed"},
        )


def find_dead_link(snapshot: Snapshot, path: Path) -> Iterator[Finding]:
    """Yield a finding if nothing comes in at either end, although both interfaces are up."""
    up, down = small_burst(path, UP), small_burst(path, DOWN)
    if up is None or down is None or (path.ping is not None and path.ping.received):
        return
    if any(
        burst.delivered or (burst.reached or 0) > burst.tried * LOST or set(burst.errors) - _NO_NEIGHBOR for burst in (up, down)
    ):
        return
    yield make_finding(
        "link-dead",
        where="link",
        cause=f"nothing passes between {path.laptop.interface} and {path.robot.interface if path.robot else 'the robot'}, "
        "although both have a carrier: a switch or access point in between, or the radio, is down",
        evidence=(path.laptop.line(), *((path.robot.line(),) if path.robot else ()), up.line(), down.line()),
        explains=ABOVE,
        **try_another_transport(snapshot),
    )


def find_silent_robot(snapshot: Snapshot, path: Path) -> Iterator[Finding]:
    """Yield a finding if the robot answers nothing, although the login failed for a reason of the laptop's own."""
    link, ping = snapshot.link, path.ping
    if link is None or not link.unasked or path.robot is not None or ping is None or path.knock is None:
        return
    if ping.received or path.knock.answered or set(path.answers.values()) - {SILENT}:
        return
    yield make_finding(
        "link-dead",
        where="link",
        cause=f"nothing at {path.address} answers, neither ping nor a datagram nor sshd: the robot is off, or packets to it or "
        "back are lost",
        evidence=(
            path.laptop.line(),
            f"ping {path.address}: {ping.received} of {ping.sent} answered",
            *(f"a datagram to UDP {port} of {path.address}: {answer}" for port, answer in path.answers.items()),
            path.knock.line(),
        ),
        explains=ABOVE - {"robot-unreachable"},
        **try_another_transport(snapshot),
    )
