"""How the ends of a path are mended: an address, a route, a packet filter, a program that does not read. Pure."""

from __future__ import annotations

import re
from collections.abc import Sequence
from ipaddress import IPv4Interface, ip_address, ip_network
from itertools import pairwise

from lupin_cli.checks.base import Snapshot
from lupin_cli.checks.packet_filter import let_packets_pass
from lupin_cli.checks.remote_command import FixText, command_on, restart_processes, robot_option, show_transports
from lupin_cli.checks.robot_address import ACCESS_POINT, is_from_router, robot_address
from lupin_cli.facts.addresses import ADDRESSES, Address
from lupin_cli.facts.ros_processes import ROS_PROCESSES
from lupin_cli.link.path import Burst, End, Path

_NO_WAY = re.compile(r"\b(blackhole|unreachable|prohibit)\b")  # kinds of routes and rules of ip(8) that lead nowhere
# Selectors of rules that hold for some of a machine's packets only, and that packets of DDS have nothing to do with.
_SELECTS_OTHERS = {"not", "fwmark", "iif", "oif", "uidrange", "ipproto", "sport", "dport", "tos", "dsfield", "l3mdev"}
_ROUTE_FLAGS = re.compile(r"( (linkdown|dead|pervasive|offload|rt_offload|trap|rt_trap|offload_failed|rt_offload_failed))+$")
ANOTHER_TRANSPORT = "look at the switch or access point in between, or use another transport; the command shows which answers"


def try_another_transport(snapshot: Snapshot) -> FixText:
    """Return what is left if packets are lost between the interfaces."""
    return FixText(command=show_transports(snapshot), instruction=ANOTHER_TRANSPORT)


def own_addresses(snapshot: Snapshot, machine: str) -> tuple[Address, ...] | None:
    """Return a machine's addresses that others can reach; None if they are not known."""
    facts = snapshot.robot if machine == "robot" else snapshot.laptop
    addresses = facts.get(ADDRESSES) if facts is not None else None
    return tuple(each for each in addresses.entries if each.scope == "global") if addresses is not None else None


def laptop_addresses_near_robot(snapshot: Snapshot) -> list[Address]:
    """Return the laptop's addresses in the robot's network; none behind a gateway, or if an address is not known."""
    robot = robot_address(snapshot)
    return [each for each in own_addresses(snapshot, "laptop") or () if robot and each.on_same_subnet(robot)]


def add_address(snapshot: Snapshot, path: Path, machine: str, other: str) -> FixText:
    """Return how an end gets an address again: the robot the one that is in use, the laptop one in the robot's network."""
    facts = snapshot.robot if machine == "robot" else snapshot.laptop
    addresses = facts.get(ADDRESSES) if facts is not None else None
    unused = addresses.unused if addresses is not None else ()
    interface = unused[0] if len(unused) == 1 else ""
    if is_from_router(snapshot, path.address):
        return FixText(
            command=command_on(snapshot, machine, "ip -brief address"),
            instruction=f"let the router give the {machine} an address again: plug the cable out and in, or join its WiFi; "
            "the command lists the interfaces",
        )
    near = own_addresses(snapshot, "laptop" if machine == "robot" else "robot") or ()
    length = next((each.prefix_length for each in near if each.on_same_subnet(path.address)), 24)
    if machine == "robot":
        address, interface = path.address, interface or ("wlan0" if path.address == ACCESS_POINT else "eth0")
    else:
        hosts = IPv4Interface(f"{other}/{length}").network.hosts()
        address = next((str(host) for host in hosts if str(host) != other), "")
    if not (interface and address):
        return FixText(
            command=command_on(snapshot, machine, "ip -brief address"),
            instruction=f"let the {machine} get an address in the network of {other} again: plug the cable out and in, or join "
            "the robot's WiFi; the command lists the interfaces",
        )
    return FixText(
        command=command_on(snapshot, machine, f"sudo ip address add {address}/{length} dev {interface}"),
        instruction="the address lasts until the next boot; correct the network settings, too",
    )


def correct_route(snapshot: Snapshot, end: End, other: str, near: Sequence[Address]) -> FixText:
    """Return how an end's packets to the other one take the interface of their network: what leads elsewhere is deleted."""
    sources = {end.address, *(each.address for each in near)}
    rules = [
        rule.partition(":")[0]
        for rule in end.rules
        if (other in rule.split() or _NO_WAY.search(rule)) and _holds_for(rule, sources, other)
    ]
    wrong = [_ROUTE_FLAGS.sub("", route) for route in end.routes if not route.startswith("default") and not _uses(route, near)]
    commands = [f"sudo ip rule del priority {priority}" for priority in rules]
    commands += [f"sudo ip route del {route}" for route in wrong]
    if not commands and near and not any(_uses(route, near) for route in end.routes):
        network = IPv4Interface(f"{near[0].address}/{near[0].prefix_length}").network
        commands = [f"sudo ip route add {network} dev {near[0].interface} src {near[0].address}"]
    if commands:
        return FixText(command=command_on(snapshot, end.machine, " && ".join(commands)))
    return FixText(
        command=command_on(snapshot, end.machine, f"ip route get {other}"),
        instruction=f"give the {end.machine} a route to {other}, over the interface of that network",
    )


def _holds_for(rule: str, sources: set[str], other: str) -> bool:
    """Return whether a rule of ip(8) holds for all packets of a machine with these addresses to the `other` end."""
    words = rule.partition(":")[2].replace(" iif lo", "").split()  # `iif lo`: packets of this machine itself
    selectors = dict(pairwise(words))
    if _SELECTS_OTHERS & set(words):
        return False
    leaves = selectors.get("from", "all") == "all" or any(_contains(selectors["from"], source) for source in sources if source)
    return leaves and ("to" not in selectors or _contains(selectors["to"], other))


def _contains(network: str, address: str) -> bool:
    try:
        return ip_address(address) in ip_network(network, strict=False)
    except ValueError:
        return False


def _uses(route: str, near: Sequence[Address]) -> bool:
    """Return whether a route leaves by the interface of one of these addresses."""
    return any(f" dev {each.interface} " in f"{route} " for each in near)


def let_burst_pass(snapshot: Snapshot, path: Path, machine: str, burst: Burst, ports: Sequence[int]) -> FixText:
    """Return how the packet filter of a machine lets the packets of a burst pass."""
    end = path.robot if machine == "robot" and path.robot is not None else path.laptop
    other = path.laptop.address if machine == "robot" else path.address
    rules, incoming = path.filters.get(machine, ()), machine == burst.receiver
    own = {path.address, end.address} if machine == "robot" else {end.address}
    return let_packets_pass(
        snapshot, machine, rules, ports, end.interface, other, incoming=incoming, own=sorted(filter(None, own))
    )


def accept_other_route(snapshot: Snapshot, path: Path, machine: str) -> FixText:
    """Return how a machine accepts packets although its route back to their sender is another one."""
    interface = next((end.interface for end in (path.laptop, path.robot) if end and end.machine == machine), "all")
    return FixText(
        command=command_on(snapshot, machine, f"sudo sysctl -w net/ipv4/conf/{interface}/rp_filter=2"),
        # With slashes: the name of a VLAN's interface has dots.
        instruction=f"better, correct the route of the {machine} back to the sender; the command lets it accept the packets "
        "until the next boot",
    )


def resume_or_restart(snapshot: Snapshot, machine: str, pid: int, port: int) -> FixText:
    """Return how the owner of a port reads it again: a stopped process goes on, one that hangs starts again."""
    if not pid:
        return FixText(
            command=command_on(snapshot, machine, f"sudo ss -lunp 'sport = :{port}'"),
            instruction=f"let the program that owns UDP {port} go on, or start it again; the command names it",
        )
    facts = snapshot.robot if machine == "robot" else snapshot.laptop
    processes = (facts.get(ROS_PROCESSES) if facts is not None else None) or ()
    if hanging := [process for process in processes if process.pid == pid and process.state not in ("T", "t")]:
        return restart_processes(snapshot, machine, hanging)
    if machine == "robot":
        return FixText(command=f"lupin play resume-process{robot_option(snapshot)} -v pid={pid}")
    return FixText(command=f"kill -CONT {pid}")
