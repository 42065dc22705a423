"""What `lupin deploy laptop` sets up for a robot of the inventory: its address, the network around it, its WiFi."""

from __future__ import annotations

import socket
from collections.abc import Iterable, Sequence
from ipaddress import AddressValueError, IPv4Address, IPv4Interface, IPv4Network

from lupin_cli.connection.destination import parse_destination
from lupin_cli.connection.inventory import ConfigError, Robot

ACCESS_POINT_PREFIX = "mirte"  # the vendor's image calls its access point Mirte-<serial>


def choose_variables(robot: Robot, networks: Sequence[IPv4Network], saved_wifi: Iterable[str]) -> dict[str, str]:
    """Return the variables of the playbook deploy-laptop for a robot.

    The address is that of the pinned transport, else the first in one of this machine's networks, else the first. The WiFi is
    that of the inventory, else the only saved one that is called as the vendor calls them; without one, there is no `ssid`.
    Raises ConfigError if the robot has no IPv4 address.
    """
    hosts = []
    for transport in [robot.transport] if robot.transport else robot.addresses:
        try:
            hosts.append(IPv4Address(parse_destination(robot.addresses[transport])[1]))
        except AddressValueError:
            continue  # a name, which a DDS profile cannot have
    if not hosts:
        raise ConfigError(
            f"{robot.name} has no IPv4 address in the inventory; pass it with -v robot_ip=ADDRESS",
            f"lupin robots check {robot.name}",
        )
    address, network = next(
        ((host, network) for host in hosts for network in networks if host in network),
        (hosts[0], IPv4Interface(f"{hosts[0]}/24").network),
    )
    vendor = [name for name in saved_wifi if name.lower().startswith(ACCESS_POINT_PREFIX)]
    ssid = robot.ssid or (vendor[0] if len(vendor) == 1 else "")
    return {"robot_ip": str(address), "network": str(network), **({"ssid": ssid} if ssid else {})}


def own_networks() -> list[IPv4Network]:
    """Return the IPv4 networks of this machine's interfaces."""
    import psutil

    return [
        IPv4Interface(f"{each.address}/{each.netmask}").network
        for addresses in psutil.net_if_addrs().values()
        for each in addresses
        if each.family == socket.AF_INET and each.netmask
    ]


def saved_wifi() -> list[str]:
    """Return the names of NetworkManager's saved WiFi connections; none without NetworkManager."""
    from lupin_cli.connection.base import TargetError
    from lupin_cli.connection.local import LocalTarget
    from lupin_cli.facts import networkmanager

    try:
        manager = networkmanager.parse(LocalTarget().run(networkmanager.PROBE, timeout_s=5.0))
    except (TargetError, ValueError):
        return []
    return [profile.name for profile in manager.profiles if profile.wireless]
