"""The address at which the robot was reached, or was tried."""

from __future__ import annotations

from ipaddress import AddressValueError, IPv4Address, ip_address, ip_interface

from lupin_cli.checks.base import Snapshot
from lupin_cli.checks.remote_command import FixText, source_exports
from lupin_cli.facts.routes import ROUTES

ACCESS_POINT = "192.168.42.1"  # the address of a stock robot's access point, on wlan0
CABLE = "10.42.0.1"  # that of its cable, on eth0


def robot_address(snapshot: Snapshot) -> str:
    """Return the robot's IPv4 address on the link. Empty if no robot was selected or its name was not resolved."""
    if snapshot.link is None:
        return ""
    address = snapshot.link.address
    if address.replace(".", "").isdigit():
        return address
    routes = snapshot.laptop.get(ROUTES)
    return routes.names.get(address, "") if routes is not None else ""


def set_up_laptop(
    snapshot: Snapshot, address: str = "", *, options: str = "", instruction: str = "", source: bool = True
) -> FixText:
    """Return how this machine and the terminal that the line is pasted into join the graph of the robot at `address`.

    The default is the address of the connection. `options` are those of `lupin dds setup`. Without `source`, the terminal
    keeps its variables.
    """
    target = address or robot_address(snapshot) or (snapshot.link.address if snapshot.link else "")
    try:
        IPv4Address(target)
    except AddressValueError:
        return FixText(instruction="type `lupin dds setup` with the robot's IPv4 address, which is not known here")
    then = source_exports(snapshot) if source else ""
    command = f"lupin dds setup {target}{options}" + (f" && {then}" if then else "")
    return FixText(command=command, instruction=instruction)


def own_hosts(snapshot: Snapshot) -> dict[str, str]:
    """Return the robot's addresses as the laptop knows them, with the transport of each: no other robot has them."""
    link, routes = snapshot.link, snapshot.laptop.get(ROUTES)
    if link is None:
        return {}
    hosts = {host: transport for transport, host in link.addresses.items()}
    hosts.setdefault(link.address, link.transport)
    names = routes.names if routes is not None else {}
    return {names.get(host, host): transport for host, transport in hosts.items()}


def is_direct(snapshot: Snapshot, address: str) -> bool:
    """Return whether one of the robot's addresses is that of its cable or of its access point, which no gateway leads to."""
    transport = snapshot.link.transport if snapshot.link is not None else ""
    return own_hosts(snapshot).get(address, transport) in ("wired", "ap")


def is_by_cable(snapshot: Snapshot) -> bool:
    """Return whether the robot's address is that of its cable."""
    address = robot_address(snapshot)
    transport = own_hosts(snapshot).get(address, "")
    return transport == "wired" or (not transport and address == CABLE)


def is_from_router(snapshot: Snapshot, address: str) -> bool:
    """Return whether a router leases this address of the robot, so that others of its network are the router's to give.

    The robot itself gives those of its cable and its access point.
    """
    if transport := own_hosts(snapshot).get(address, ""):
        return transport == "router"
    return not any(ip_address(address) in ip_interface(f"{own}/24").network for own in (CABLE, ACCESS_POINT))


def is_of_examined_robot(snapshot: Snapshot, host: str) -> bool:
    """Return whether an address is that of another robot that is examined too. One robot may have several addresses."""
    routes = snapshot.laptop.get(ROUTES)
    return routes is not None and host in routes.to_robot and host not in own_hosts(snapshot)
