"""The network path to the robot: unreachable, unplugged, or lost because the laptop's WiFi roamed."""

from __future__ import annotations

import shlex
from collections.abc import Iterator

from lupin_cli.checks.base import Check, Finding, Snapshot
from lupin_cli.checks.findings import OVER_GRAPH, make_finding
from lupin_cli.checks.robot_address import robot_address
from lupin_cli.facts.addresses import ADDRESSES
from lupin_cli.facts.networkmanager import NETWORK_MANAGER, NetworkManager, Profile
from lupin_cli.facts.routes import ROUTES, RoutingTable

# The vendor's image calls its access point Mirte-<serial>.
ACCESS_POINT_PREFIX = "mirte"
PINNED_PRIORITY = 100

# Kind of failure → what it means, and the next command.
_FAILURES: dict[str, tuple[str, str]] = {
    "no-route": ("no network of the laptop leads to the robot: the link is down, not the robot", "ip route get {address}"),
    "timeout": ("packets get no answer: the robot is off, still booting, or out of range", "ping -c 3 {address}"),
    "refused": (
        "a computer answers at this address but runs no SSH server: it is booting, or sshd is down",
        "ping -c 3 {address}",
    ),
    "silent": (
        "the SSH server accepts the connection and sends nothing: the robot hangs, or is out of memory or processes",
        "ping -c 3 {address}",
    ),
    "name": ("the laptop cannot resolve the name", "getent ahosts {address}"),
    "lost": ("the connection broke while it was in use", "ping -c 3 {address}"),
    "host-key-changed": ("the host key differs from the accepted one: a new image, or another machine at this address", ""),
    "host-key-unknown": ("nobody has accepted this robot's host key yet", "lupin robots check {robot}"),
    "authentication": ("the robot accepts none of this user's keys and passwords", "ssh -v {address}"),
}


def find_unreachable_robot(snapshot: Snapshot) -> Iterator[Finding]:
    """The robot did not answer over SSH."""
    link = snapshot.link
    if link is None or link.reachable:
        return
    meaning, command = _FAILURES.get(link.kind, ("the robot could not be asked", "ping -c 3 {address}"))
    routes, address = snapshot.laptop.get(ROUTES), robot_address(snapshot)
    if link.kind == "no-route" and routes is not None and address and routes.leads_to(address):
        meaning = "the laptop is on its network, and nothing answers at that address: the robot or its end of the link is off"
    yield make_finding(
        "robot-unreachable",
        where="link",
        symptom=f"{link.robot} does not answer: no topics, blank panels, dead controllers",
        cause=f"{link.address} cannot be reached ({link.kind}): {meaning}",
        evidence=(link.message, *(_route_lines(routes, address) if routes else ())),
        command=link.next_command or command.format(address=link.address, robot=link.robot),
    )


def find_roamed_wifi(snapshot: Snapshot) -> Iterator[Finding]:
    """The laptop's WiFi is on another network than the robot's access point, and no route leads to the robot."""
    manager, routes = snapshot.laptop.get(NETWORK_MANAGER), snapshot.laptop.get(ROUTES)
    address = robot_address(snapshot)
    if manager is None or routes is None or not manager.running or not address or routes.leads_to(address):
        return
    for device in manager.devices:
        on_other_network = device.type == "wifi" and device.state == "connected" and not _is_access_point(device.connection)
        saved = [
            profile
            for profile in manager.profiles
            if profile.wireless and _is_access_point(profile.name) and not profile.active
        ]
        if on_other_network and saved:
            yield make_finding(
                "wifi-roamed",
                where="laptop",
                cause=f"the laptop's WiFi has left {saved[0].name} for {device.connection}",
                evidence=(
                    f"nmcli device: {device.raw}",
                    *(f"nmcli connection: {profile.raw}" for profile in _rivals(manager, saved[0])),
                    f"nmcli connection: {saved[0].raw}",
                    *_route_lines(routes, address),
                ),
                command=f"nmcli connection up {shlex.quote(saved[0].name)}",
                explains=OVER_GRAPH | {"robot-unreachable", "wifi-may-roam"},
            )


def find_roam_risk(snapshot: Snapshot) -> Iterator[Finding]:
    """The robot's access point carries the link, and NetworkManager may prefer another saved network to it."""
    manager, routes = snapshot.laptop.get(NETWORK_MANAGER), snapshot.laptop.get(ROUTES)
    address = robot_address(snapshot)
    if manager is None or routes is None or not manager.running or not address:
        return
    route = routes.best(address)
    for profile in manager.profiles:
        used = profile.active or (route is None or route.destination == "default")
        if not (profile.wireless and _is_access_point(profile.name) and used):
            continue
        if route is not None and route.destination != "default" and route.device not in routes.wireless:
            continue  # a cable carries the link
        rivals = _rivals(manager, profile)
        if rivals:
            name = shlex.quote(profile.name)
            yield make_finding(
                "wifi-may-roam",
                where="laptop",
                cause=f"{profile.name} and {rivals[0].name} both connect automatically, and {profile.name} is not preferred",
                evidence=(f"nmcli connection: {each.raw}" for each in (profile, *rivals)),
                command=f"nmcli connection modify {name} connection.autoconnect-priority {PINNED_PRIORITY}",
                variables={"connection": profile.name, "priority": PINNED_PRIORITY},
            )


def _rivals(manager: NetworkManager, profile: Profile) -> list[Profile]:
    """Return the other WiFi profiles to which NetworkManager gives the same priority as `profile`, or a higher one."""
    priority = profile.priority if profile.autoconnect else -999
    return [
        each
        for each in manager.profiles
        if each.wireless and each.autoconnect and not _is_access_point(each.name) and each.priority >= priority
    ]


def find_missing_carrier(snapshot: Snapshot) -> Iterator[Finding]:
    """The laptop's interface on the robot's network has no carrier."""
    addresses, routes, address = snapshot.laptop.get(ADDRESSES), snapshot.laptop.get(ROUTES), robot_address(snapshot)
    if addresses is None or routes is None or not address:
        return
    on_subnet = [each for each in addresses.entries if each.scope == "global" and each.on_same_subnet(address)]
    if on_subnet and not any(each.up and each.carrier for each in on_subnet):
        interface = on_subnet[0].interface
        yield make_finding(
            "no-carrier",
            where="laptop",
            cause=f"{interface}, which leads to the robot at {address}, has no carrier: "
            "the cable is unplugged, or its other end is off",
            evidence=(*(each.line() for each in on_subnet), *_route_lines(routes, address)),
            command=f"plug the cable in, then: ip -brief link show {interface}",
            explains=OVER_GRAPH | {"robot-unreachable"},
        )


def _route_lines(routes: RoutingTable, address: str) -> list[str]:
    return [f"ip route get {address}: {line}" for line in routes.to_robot.get(address, ())]


def _is_access_point(name: str) -> bool:
    return name.lower().startswith(ACCESS_POINT_PREFIX)


CHECKS = (
    Check("link.carrier", find_missing_carrier, laptop=(ADDRESSES, ROUTES)),
    Check("link.roam", find_roamed_wifi, laptop=(NETWORK_MANAGER, ROUTES)),
    Check("link.roam-risk", find_roam_risk, laptop=(NETWORK_MANAGER, ROUTES)),
    Check("link.reachable", find_unreachable_robot, laptop=(ROUTES,)),
)
