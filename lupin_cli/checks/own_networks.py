"""A network of the laptop itself has the robot's address: packets for the robot never leave the laptop."""

from __future__ import annotations

import shlex
from collections.abc import Iterator

from lupin_cli.checks import ground_truth
from lupin_cli.checks.base import Check, Finding, Snapshot
from lupin_cli.checks.findings import OVER_GRAPH, make_finding
from lupin_cli.checks.link import NO_WAY, route_lines
from lupin_cli.checks.remote_command import FixText, service_of
from lupin_cli.checks.robot_address import is_from_router, robot_address
from lupin_cli.facts.addresses import ADDRESSES, Address, is_guest_bridge
from lupin_cli.facts.graph import GRAPH
from lupin_cli.facts.networkmanager import NETWORK_MANAGER
from lupin_cli.facts.ros_processes import ROS_PROCESSES
from lupin_cli.facts.routes import ROUTES, RoutingTable
from lupin_cli.facts.units import UNIT_STATES, VENDOR


def find_network_conflicts(snapshot: Snapshot) -> Iterator[Finding]:
    """The laptop has the robot's address itself, or its containers and virtual machines have the robot's network."""
    addresses, routes = snapshot.laptop.get(ADDRESSES), snapshot.laptop.get(ROUTES)
    if addresses is None or routes is None or snapshot.link is None or _runs_on_robot(snapshot):
        return
    for address in _addresses_in_use(snapshot, routes):
        own = next((each for each in addresses.entries if each.address == address and each.scope == "global"), None)
        device = _device(routes, address)
        bridge = next((each for each in addresses.entries if each.interface == device and is_guest_bridge(device)), None)
        if own is not None and not is_guest_bridge(own.interface):
            cause = f"{address} is this laptop's own address ({own.interface}): nothing that it sends there leaves it"
            yield _conflict(address, own, routes, cause, _give_up_address(snapshot, own))
        elif (found := own or bridge) is not None:
            cause = (
                f"{found.interface}, for containers or virtual machines of this laptop, has the network of {address}: "
                "nothing that the laptop sends there leaves it"
            )
            yield _conflict(address, found, routes, cause, _give_up_network(found))


def _addresses_in_use(snapshot: Snapshot, routes: RoutingTable) -> list[str]:
    """Return the robot's addresses at which nothing is reached: that of the connection, and that of this shell's DDS."""
    link, path = snapshot.link, snapshot.path
    broken = ground_truth.measure(snapshot).state is ground_truth.State.BROKEN
    found = [robot_address(snapshot)] if link is not None and (not link.reachable or broken) else []
    found += [path.address] if path is not None and broken and path.address in routes.to_robot else []
    return list(dict.fromkeys(filter(None, found)))


def _runs_on_robot(snapshot: Snapshot) -> bool:
    """Return whether the doctor examines the robot from the robot itself, whose addresses are its own there."""
    units, robot = snapshot.robot_fact(UNIT_STATES), snapshot.robot_fact(ADDRESSES)
    has_vendor = units is not None and units.get(VENDOR) is not None
    same = robot is not None and robot == snapshot.laptop.get(ADDRESSES)
    return (has_vendor and same) or any(service_of(each) == VENDOR for each in snapshot.laptop.get(ROS_PROCESSES) or ())


def _device(routes: RoutingTable, address: str) -> str:
    """Return the interface by which the kernel would send to an address of the robot; empty if that is not known."""
    words = " ".join(routes.to_robot.get(address, ())).split()
    return words[words.index("dev") + 1] if "dev" in words[:-1] else ""


def _give_up_address(snapshot: Snapshot, own: Address) -> FixText:
    manager = snapshot.laptop.get(NETWORK_MANAGER)
    profile = next((each.connection for each in (manager.devices if manager else ()) if each.name == own.interface), "")
    if profile:
        name = shlex.quote(profile)
        return FixText(
            command=f"nmcli connection modify {name} ipv4.method auto ipv4.addresses '' ipv4.gateway '' "
            f"&& nmcli connection up {name}",
            instruction=f"the command lets {own.interface} ask for an address; if it shared a connection, that ends",
        )
    source = "the router" if is_from_router(snapshot, own.address) else "the robot"
    return FixText(
        command=f"sudo ip address del {own.address}/{own.prefix_length} dev {own.interface}",
        instruction=f"then let {own.interface} get another address from {source}, and correct the network settings, too",
    )


def _give_up_network(own: Address) -> FixText:
    by_docker = "; Docker's are bip and default-address-pools in /etc/docker/daemon.json" if _is_dockers(own.interface) else ""
    return FixText(
        command=f"ip -brief address show dev {own.interface}",
        instruction=f"if the robot is one of them, start it; otherwise give {own.interface} another network{by_docker}",
    )


def _is_dockers(interface: str) -> bool:
    return interface.startswith(("docker", "br-"))


def _conflict(address: str, own: Address, routes: RoutingTable, cause: str, fix: FixText) -> Finding:
    return make_finding(
        "network-conflict",
        where="laptop",
        cause=cause,
        evidence=(f"laptop: {own.line()}", *route_lines(routes, address)),
        # Whatever answers at the address is the laptop's.
        explains=OVER_GRAPH | {"robot-unreachable", "no-carrier", "link-dead", "udp-lost", "wifi-roamed", *NO_WAY},
        about=address,
        **fix,
    )


CHECKS = (
    Check(
        "link.own-networks",
        find_network_conflicts,
        laptop=(ADDRESSES, ROUTES, NETWORK_MANAGER, ROS_PROCESSES, GRAPH),
        robot=(ADDRESSES, UNIT_STATES),
    ),
)
