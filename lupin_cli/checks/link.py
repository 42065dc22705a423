"""The way to the robot: unreachable, roamed off, unplugged. When everything dies at once, the laptop's network comes first."""

from __future__ import annotations

import shlex
from collections.abc import Iterator

from lupin_cli.checks.base import Check, Evidence, Finding, Fix, Severity
from lupin_cli.checks.consequences import NOBODY_ANSWERS, SEEN_OVER_THE_GRAPH
from lupin_cli.checks.way import robot_address
from lupin_cli.facts.addresses import ADDRESSES
from lupin_cli.facts.link import Link
from lupin_cli.facts.networkmanager import NETWORK_MANAGER, NetworkManager, Profile
from lupin_cli.facts.routes import ROUTES, Routes

# The vendor's image calls its access point Mirte-<serial>.
ACCESS_POINT_PREFIX = "mirte"
PINNED_PRIORITY = 100

# kind of failure: (what it means, the next command)
_MEANINGS: dict[str, tuple[str, str]] = {
    "no-route": ("no network of this machine leads to the robot: the link is down, not the robot", "ip route get {address}"),
    "timeout": ("packets vanish on the way: the robot is off, still booting, or out of range", "ping -c 3 {address}"),
    "refused": ("a computer answers there but runs no SSH server: it is still booting, or sshd is down", "ping -c 3 {address}"),
    "silent": (
        "the SSH server accepts and never says a word: the robot hangs, or is out of memory or processes",
        "ping -c 3 {address}",
    ),
    "name": ("the name means no address here", "getent ahosts {address}"),
    "lost": ("the connection broke in the middle", "ping -c 3 {address}"),
    "host-key-changed": ("another host key than the accepted one: a new image, or another machine at this address", ""),
    "host-key-unknown": ("nobody has accepted this robot's host key yet", "lupin robots check {robot}"),
    "authentication": ("the robot takes none of this user's keys and passwords", "ssh -v {address}"),
}


def find_unreachable(evidence: Evidence) -> Iterator[Finding]:
    """The robot did not answer: how, and what that means."""
    link = evidence.link
    if not isinstance(link, Link) or link.reachable:
        return
    meaning, command = _MEANINGS.get(link.kind, ("the robot could not be asked", "ping -c 3 {address}"))
    routes, address = evidence.laptop.get(ROUTES), robot_address(evidence)
    if link.kind == "no-route" and routes is not None and address and routes.leads_to(address):
        meaning = (
            "its network is here, and nobody answers there at that address: the robot is off, or the far end of the link is"
        )
    yield Finding(
        id="robot-unreachable",
        severity=Severity.PROBLEM,
        where="link",
        symptom=f"nothing of {link.robot} answers: no topics, blank panels, dead controllers",
        cause=f"{link.address} can't be reached ({link.kind}): {meaning}",
        evidence=(link.message, *(_way(routes, address) if routes else ())),
        fix=Fix(link.next_command or command.format(address=link.address, robot=link.robot)),
    )


def find_roam(evidence: Evidence) -> Iterator[Finding]:
    """The radio is on another network than the robot's access point, and no route leads to the robot."""
    manager, routes = evidence.laptop.get(NETWORK_MANAGER), evidence.laptop.get(ROUTES)
    address = robot_address(evidence)
    if manager is None or routes is None or not manager.running or not address or routes.leads_to(address):
        return
    for device in manager.devices:
        elsewhere = device.type == "wifi" and device.state == "connected" and not _is_robots(device.connection)
        saved = [
            profile for profile in manager.profiles if profile.wireless and _is_robots(profile.name) and not profile.active
        ]
        if elsewhere and saved:
            yield Finding(
                id="wifi-roamed",
                severity=Severity.PROBLEM,
                where="laptop",
                symptom="the robot stops driving and its controllers seem dead; ssh says: No route to host",
                cause=f"the WiFi of this machine has left {saved[0].name} for {device.connection}",
                evidence=(
                    f"nmcli device: {device.raw}",
                    *(f"nmcli connection: {p.raw}" for p in _rivals(manager, saved[0])),
                    f"nmcli connection: {saved[0].raw}",
                    *_way(routes, address),
                ),
                fix=Fix(f"nmcli connection up {shlex.quote(saved[0].name)}"),
                explains=NOBODY_ANSWERS | SEEN_OVER_THE_GRAPH | {"wifi-may-roam"},
            )


def find_roam_risk(evidence: Evidence) -> Iterator[Finding]:
    """The robot's access point carries the link, and another saved network would be as welcome."""
    manager, routes = evidence.laptop.get(NETWORK_MANAGER), evidence.laptop.get(ROUTES)
    address = robot_address(evidence)
    if manager is None or routes is None or not manager.running or not address:
        return
    over = routes.best(address)
    for profile in manager.profiles:
        used = profile.active or (over is None or over.destination == "default")
        if not (profile.wireless and _is_robots(profile.name) and used):
            continue
        if over is not None and over.destination != "default" and over.device not in routes.wireless:
            continue  # a cable carries the link: the radio may go where it likes
        rivals = _rivals(manager, profile)
        if rivals:
            yield Finding(
                id="wifi-may-roam",
                severity=Severity.WARNING,
                where="laptop",
                symptom="the link dies in mid session, without anybody having touched anything",
                cause=f"{profile.name} and {rivals[0].name} both connect by themselves, and {profile.name} isn't preferred",
                evidence=tuple(f"nmcli connection: {each.raw}" for each in (profile, *rivals)),
                fix=Fix(
                    f"nmcli connection modify {shlex.quote(profile.name)} connection.autoconnect-priority {PINNED_PRIORITY}",
                    playbook="pin-wifi",
                    variables={"connection": profile.name, "priority": PINNED_PRIORITY},
                    safe=True,
                ),
            )


def _rivals(manager: NetworkManager, profile: Profile) -> list[Profile]:
    """Other radio profiles that NetworkManager would take as gladly as `profile`, or more so."""
    priority = profile.priority if profile.autoconnect else -999
    return [
        each
        for each in manager.profiles
        if each.wireless and each.autoconnect and not _is_robots(each.name) and each.priority >= priority
    ]


def find_unplugged(evidence: Evidence) -> Iterator[Finding]:
    """An interface of this machine is meant for the robot's network, and carries nothing."""
    addresses, routes, address = evidence.laptop.get(ADDRESSES), evidence.laptop.get(ROUTES), robot_address(evidence)
    if addresses is None or routes is None or not address:
        return
    near = [each for each in addresses.every if each.scope == "global" and each.has_neighbour(address)]
    if near and not any(each.up and each.carrier for each in near):
        yield Finding(
            id="no-carrier",
            severity=Severity.PROBLEM,
            where="laptop",
            symptom=f"nothing of the robot answers on {address}",
            cause=f"{near[0].interface}, which leads to the robot, has no carrier: the cable is out, or its other end is off",
            evidence=(*(each.line() for each in near), *_way(routes, address)),
            fix=Fix(f"plug the cable in, then: ip -brief link show {near[0].interface}"),
            explains=NOBODY_ANSWERS | SEEN_OVER_THE_GRAPH,
        )


def _way(routes: Routes, address: str) -> list[str]:
    return [f"ip route get {address}: {line}" for line in routes.to_robot.get(address, ())]


def _is_robots(name: str) -> bool:
    return name.lower().startswith(ACCESS_POINT_PREFIX)


CHECKS = (
    Check("link.carrier", find_unplugged, laptop=(ADDRESSES, ROUTES)),
    Check("link.roam", find_roam, laptop=(NETWORK_MANAGER, ROUTES)),
    Check("link.roam-risk", find_roam_risk, laptop=(NETWORK_MANAGER, ROUTES)),
    Check("link.reachable", find_unreachable, laptop=(ROUTES,)),
)
