"""The laptop's WiFi has left the robot's access point for another network, or may do so."""

from __future__ import annotations

import shlex
from collections.abc import Iterator

from lupin_cli.checks.base import Check, Finding, Snapshot
from lupin_cli.checks.findings import OVER_GRAPH, make_finding
from lupin_cli.checks.link import NO_WAY, route_lines
from lupin_cli.checks.remote_command import FixText
from lupin_cli.checks.robot_address import ACCESS_POINT, robot_address
from lupin_cli.facts.networkmanager import NETWORK_MANAGER, NetworkManager, Profile
from lupin_cli.facts.routes import ROUTES

# The vendor's image calls its access point Mirte-<serial>.
ACCESS_POINT_PREFIX = "mirte"
PINNED_PRIORITY = 100


def find_roamed_wifi(snapshot: Snapshot) -> Iterator[Finding]:
    """The laptop's WiFi is on another network than the robot's access point, and neither a route nor a gateway leads to it."""
    manager, routes, link = snapshot.laptop.get(NETWORK_MANAGER), snapshot.laptop.get(ROUTES), snapshot.link
    address = robot_address(snapshot)
    if manager is None or routes is None or not manager.running or not address or routes.leads_to(address):
        return
    if link is None or link.reachable or not _is_at_access_point(snapshot):
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
                cause=f"the laptop's WiFi has left {' or '.join(each.name for each in saved)} for {device.connection}",
                evidence=(
                    f"nmcli device: {device.raw}",
                    *(f"nmcli connection: {profile.raw}" for profile in _rivals(manager, saved[0])),
                    *(f"nmcli connection: {profile.raw}" for profile in saved),
                    *route_lines(routes, address),
                ),
                explains=OVER_GRAPH | {"robot-unreachable", "wifi-may-roam", *NO_WAY},
                **_join(saved),
            )


def _join(saved: list[Profile]) -> FixText:
    """Return how the laptop joins the access point again; only a person knows which of several is this robot's."""
    if len(saved) == 1:
        return FixText(command=f"nmcli connection up {shlex.quote(saved[0].name)}")
    return FixText(
        command="nmcli device wifi list", instruction="join the access point of this robot; the command lists those in reach"
    )


def find_roam_risk(snapshot: Snapshot) -> Iterator[Finding]:
    """The robot's access point carries the link, and NetworkManager may prefer another saved network to it."""
    manager, routes = snapshot.laptop.get(NETWORK_MANAGER), snapshot.laptop.get(ROUTES)
    address = robot_address(snapshot)
    if manager is None or routes is None or not manager.running or not address:
        return
    route = routes.best(address)
    for profile in manager.profiles:
        used = profile.active or ((route is None or route.destination == "default") and _is_at_access_point(snapshot))
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


def _is_at_access_point(snapshot: Snapshot) -> bool:
    """Return whether the robot's address is that of its access point."""
    return snapshot.link is not None and (snapshot.link.transport == "ap" or robot_address(snapshot) == ACCESS_POINT)


def _rivals(manager: NetworkManager, profile: Profile) -> list[Profile]:
    """Return the other WiFi profiles to which NetworkManager gives the same priority as `profile`, or a higher one."""
    priority = profile.priority if profile.autoconnect else -999
    return [
        each
        for each in manager.profiles
        if each.wireless and each.autoconnect and not _is_access_point(each.name) and each.priority >= priority
    ]


def _is_access_point(name: str) -> bool:
    return name.lower().startswith(ACCESS_POINT_PREFIX)


CHECKS = (
    Check("link.roam", find_roamed_wifi, laptop=(NETWORK_MANAGER, ROUTES)),
    Check("link.roam-risk", find_roam_risk, laptop=(NETWORK_MANAGER, ROUTES)),
)
