"""The network path to the robot: unreachable, or unplugged."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from lupin_cli.checks import ground_truth
from lupin_cli.checks.base import Check, Finding, Snapshot
from lupin_cli.checks.dds_environment import server_host
from lupin_cli.checks.findings import OVER_GRAPH, make_finding
from lupin_cli.checks.layers import EVERYTHING
from lupin_cli.checks.packet_filter import SSH_PORT, let_packets_pass
from lupin_cli.checks.remote_command import FixText, command_on, show_transports
from lupin_cli.checks.robot_address import is_by_cable, is_direct, own_hosts, robot_address, set_up_laptop
from lupin_cli.facts.addresses import ADDRESSES, Address, Addresses, is_guest_bridge, is_tunnel
from lupin_cli.facts.base import Facts
from lupin_cli.facts.link import Link
from lupin_cli.facts.networkmanager import NETWORK_MANAGER
from lupin_cli.facts.routes import ROUTES, RoutingTable
from lupin_cli.link.path_agent import REFUSED


@dataclass(frozen=True)
class _Failure:
    """A kind of failed connection: what it means, the next command, and the machine at which its cause lies.

    `needs_life`: the machine is only to blame if the robot answers in another way; otherwise it is the link.
    """

    meaning: str
    command: str = "{shows}"  # what shows which transports answer; it needs no tool that may be missing
    where: str = "link"
    needs_life: bool = False
    instruction: str = ""  # what a person must know or do besides the command
    by_hand: bool = False  # nothing that is typed on the laptop helps


_FAILURES = {
    "no-route": _Failure(
        "no network of the laptop leads to the robot: the link is down, not the robot",
        "ip route get {address}",
        instruction="plug the cable in, or join the robot's WiFi; the command shows by which interface the laptop would send",
    ),
    "timeout": _Failure(
        "packets get no answer: the robot is off, still booting, or out of range",
        instruction="switch the robot on, wait until it has booted, or come closer; the command shows whether it answers",
    ),
    "refused": _Failure(
        "a computer at this address refuses TCP 22: it is booting, sshd is down, or a firewall rejects the port",
        where="robot",
        instruction="wait until the robot has booted; if that does not help, start sshd on it with screen and keyboard, or "
        "switch the robot off and on",
        by_hand=True,
    ),
    "silent": _Failure(
        "the SSH server accepts the connection and sends nothing: the robot hangs, or is out of memory or processes",
        where="robot",
        instruction="wait a minute; if that does not help, switch the robot off and on",
        by_hand=True,
    ),
    "name": _Failure(
        "the laptop cannot resolve the name",
        "getent ahosts {address}",
        "laptop",
        instruction="correct the name in the inventory or in the SSH configuration; the command shows what it stands for",
    ),
    "lost": _Failure(
        "the connection broke while it was in use",
        instruction="type the same again; if it happens again, come closer or use a cable",
    ),
    "host-key-changed": _Failure(
        "the host key differs from the accepted one: a new image, or another machine at this address",
        "",
        instruction="find out why the key differs; forget the accepted one only if the robot got a new image",
    ),
    "host-key-unknown": _Failure("this robot's host key was not accepted yet", "lupin robots check {robot}", where="laptop"),
    "ssh-config": _Failure(
        "the laptop's SSH configuration cannot be used; the robot itself was not asked", "ssh -G {address}", where="laptop"
    ),
    "jump": _Failure(
        "a jump host or proxy command of the laptop's SSH configuration does not work; the robot itself was not asked",
        "{login} -v",
        where="laptop",
        needs_life=True,
        instruction="correct ProxyJump or ProxyCommand in the SSH configuration; the command shows where it fails",
    ),
    "private-key": _Failure(
        "this user's private key is damaged",
        "{login} -v",
        where="laptop",
        instruction="replace the damaged key; the command shows which one it is",
    ),
    "no-key": _Failure("this user has no private key, which the robot could accept", "{login} -v", where="laptop"),
    "authentication": _Failure(
        "the robot accepts none of this user's keys and passwords",
        "{login} -v",
        where="robot",
        instruction="let the robot accept a key of this user, with ssh-copy-id; the command shows what was tried",
    ),
    "login-shell": _Failure(
        "the robot accepts the login, and its user's login shell runs no command",
        "{login} 'echo fine'",
        where="robot",
        instruction="at the robot's own keyboard, correct the shell in /etc/passwd or its startup files; the command tries it",
    ),
    "root": _Failure("sudo on the robot refuses this user", "{terminal} sudo true", where="robot"),
}
_OTHER_FAILURE = _Failure("the robot could not be asked")
NO_WAY = ("address-missing", "no-route", "route-elsewhere")  # what follows if the laptop has left the robot's network
_ONLY_SSH = "only SSH fails: a firewall stops TCP 22, or sshd hangs"
_DROPS_ANSWERS = "drops the answers of sshd"
_WIRELESS = "wl"  # how systemd and the kernel begin the name of a WiFi interface
_NO_ANSWER = ("no-route", "timeout")  # kinds of failure that need not be the fault of SSH


def find_unreachable_robot(snapshot: Snapshot) -> Iterator[Finding]:
    """The robot did not answer over SSH."""
    link = snapshot.link
    if link is None or link.reachable:
        return
    failure = _FAILURES.get(link.kind, _OTHER_FAILURE)
    routes, address = snapshot.laptop.get(ROUTES), robot_address(snapshot)
    login, alive = link.login or f"ssh {link.address}", _signs_of_life(snapshot)
    on_network = routes is not None and bool(address) and routes.leads_to(address)
    meaning, where, layer = failure.meaning, failure.where, "login"
    if failure.needs_life and not alive:
        where = "link"
    terminal, shows = login.replace("ssh ", "ssh -t ", 1), show_transports(snapshot)
    command = _next_command(link) or failure.command.format(
        address=link.address, robot=link.robot, login=login, terminal=terminal, shows=shows
    )
    fix = FixText(instruction=failure.instruction, command="" if failure.by_hand else command)
    is_down = link.kind in _NO_ANSWER and not alive
    if is_down:
        where, layer = _place_of_silence(snapshot, address, on_network=on_network)
        if on_network and link.kind == "no-route":
            meaning = (
                "the laptop is on its network, and nothing answers at that address: the robot or its end of the link is off"
            )
    elif not link.unasked and (taken := _taken_by_own_filter(snapshot)):
        meaning, where = f"this machine's own packet filter {taken}", "laptop"
        fix = let_packets_pass(snapshot, "laptop", (), [SSH_PORT], "", link.address, incoming=taken == _DROPS_ANSWERS)
    elif alive and link.kind in _NO_ANSWER and (heard_at := _other_address(snapshot)) in own_hosts(snapshot):
        meaning = f"no SSH server answers there, while the robot's data arrives from {heard_at}, another of its addresses"
        where, layer = _place_of_silence(snapshot, address, on_network=on_network)
        fix = FixText(
            instruction=f"use {heard_at} for SSH too; the command shows which of the robot's addresses answer",
            command=show_transports(snapshot),
        )
    elif alive and link.kind in _NO_ANSWER and heard_at:
        meaning = f"the robot's data arrives from {heard_at}: the inventory has another address"
        where, layer = "laptop", "address"
        fix = FixText(
            instruction=f"write the address {heard_at} of {link.robot} into the inventory", command="lupin robots list"
        )
    elif alive and link.kind in _NO_ANSWER and _address_is_silent(snapshot):
        meaning = "nothing answers at this address, not even ping, while the robot's data arrives by another one"
        where, layer = _place_of_silence(snapshot, address, on_network=on_network)
    elif alive and link.kind in _NO_ANSWER:
        meaning, where = _ONLY_SSH, "robot"
        fix = FixText(instruction="start sshd on the robot, and look at its packet filter, with screen and keyboard")
    yield make_finding(
        "robot-unreachable",
        where=where,
        symptom=f"{link.robot} does not answer SSH: nothing can be asked, deployed or fixed there"
        if alive
        else f"{link.robot} does not answer: no topics, blank panels, dead controllers",
        cause=f"{link.address} cannot be reached ({link.kind}): {meaning}",
        evidence=(link.message, *alive, *_knock_lines(snapshot), *(route_lines(routes, address) if routes else ())),
        **fix,
        layer=layer,
        breaks=(EVERYTHING,) if is_down else (),
        explains=OVER_GRAPH if is_down else (),
    )


def _taken_by_own_filter(snapshot: Snapshot) -> str:
    """Return what this machine's packet filter does with a connection to the robot's sshd; empty if it lets it pass."""
    link, knock = snapshot.link, snapshot.path.knock if snapshot.path is not None else None
    if (link is not None and "not permitted" in link.message) or (knock is not None and knock.unsent):
        return "stops the connection"
    return _DROPS_ANSWERS if knock is not None and knock.loses_answers else ""


def _knock_lines(snapshot: Snapshot) -> tuple[str, ...]:
    return (snapshot.path.knock.line(),) if snapshot.path is not None and snapshot.path.knock is not None else ()


def _place_of_silence(snapshot: Snapshot, address: str, *, on_network: bool) -> tuple[str, str]:
    """Return the machine and the layer at which the path ends while nothing of the robot answers, as the laptop shows it."""
    addresses, link = snapshot.laptop.get(ADDRESSES), snapshot.link
    if on_network or addresses is None or link is None or not address:
        return "link", "carrier"
    if link.kind == "timeout" and not is_direct(snapshot, address):
        return "link", "carrier"  # a router may lead to it
    near = any(each.scope == "global" and each.on_same_subnet(address) for each in addresses.entries)
    return "laptop", "route" if near else "address"


def _address_is_silent(snapshot: Snapshot) -> bool:
    """Return whether the kernel at the robot's address answered neither ping nor datagrams to closed ports."""
    path = snapshot.path
    return path is not None and path.ping is not None and not path.ping.received and REFUSED not in path.answers.values()


def _next_command(link: Link) -> str:
    """Return the command that the failed connection advises; empty if the doctor itself or a better one takes its place."""
    return "" if link.next_command.startswith(("lupin doctor", "ping ")) else link.next_command


def _other_address(snapshot: Snapshot) -> str:
    """Return the address from which this machine receives the robot's data, if it is another than that of the connection."""
    truth, link = ground_truth.measure(snapshot), snapshot.link
    host = server_host(truth.environment.get("ROS_DISCOVERY_SERVER", ""))
    return host if link is not None and truth.heard and host.replace(".", "").isdigit() and host != link.address else ""


def _signs_of_life(snapshot: Snapshot) -> list[str]:
    """Return what arrives from the robot although it does not answer SSH, as evidence lines."""
    truth, ping = ground_truth.measure(snapshot), snapshot.path.ping if snapshot.path is not None else None
    found = [f"arrives here: {report.line()}" for report in truth.topics if report.samples][:3]
    if ping is not None and ping.received:
        found.append(f"ping {snapshot.path.address if snapshot.path else ''}: {ping.received} of {ping.sent} answered")
    return found


def find_missing_carrier(snapshot: Snapshot) -> Iterator[Finding]:
    """The interface of an end on the network of the robot's address, over SSH or in the DDS configuration, has no carrier.

    An interface that somebody switched off is the fault of its machine. One that is on and has no carrier is not: the cable, a
    switch or the other end is. NetworkManager takes the address away with the carrier.
    """
    addresses, routes, link = snapshot.laptop.get(ADDRESSES), snapshot.laptop.get(ROUTES), snapshot.link
    if addresses is None or routes is None or link is None:
        return
    in_use = [snapshot.path.address] if snapshot.path is not None else []
    for address in dict.fromkeys(filter(None, (*in_use, robot_address(snapshot)))):
        for facts in snapshot.machines:
            if found := _without_carrier(facts, address):
                yield _missing_carrier(snapshot, facts.machine, address, found, routes)
                break  # the other end has no carrier either
    yield from _unplugged(snapshot, addresses, routes)


def _without_carrier(facts: Facts, address: str) -> tuple[Address, ...]:
    """Return a machine's addresses in the network of `address` if no interface that has one works; the robot's is `address`.

    The interface of containers has a carrier while one of them runs; it leads to no robot.
    """
    addresses = facts.get(ADDRESSES)
    if addresses is None:
        return ()
    near = tuple(
        each
        for each in addresses.entries
        if each.scope == "global" and (each.address == address if facts.machine == "robot" else each.on_same_subnet(address))
        if not is_guest_bridge(each.interface)
    )
    return () if any(each.up and each.carrier for each in near) else near


def _unplugged(snapshot: Snapshot, addresses: Addresses, routes: RoutingTable) -> Iterator[Finding]:
    """Yield a finding if the robot's cable leads nowhere: no address is near it, and the only socket has no carrier."""
    manager, link, address = snapshot.laptop.get(NETWORK_MANAGER), snapshot.link, robot_address(snapshot)
    if manager is None or link is None or link.reachable or link.kind not in _NO_ANSWER or not is_by_cable(snapshot):
        return
    wired = [each for each in manager.devices if each.type == "ethernet"]
    near = any(each.scope == "global" and each.on_same_subnet(address) for each in addresses.entries if address)
    if len(wired) != 1 or wired[0].state != "unavailable" or near or not address:
        return
    yield make_finding(
        "no-carrier",
        where="link",
        cause=f"{wired[0].name}, the laptop's only interface for a cable, has no carrier: the cable is unplugged, or its other "
        "end is off",
        evidence=(f"nmcli device: {wired[0].raw}", *route_lines(routes, address)),
        instruction=f"plug the cable into {wired[0].name} of the laptop and into the robot, and switch the robot on",
        explains=OVER_GRAPH | {"robot-unreachable", "link-dead", *NO_WAY},
    )


def _missing_carrier(
    snapshot: Snapshot, machine: str, address: str, near: tuple[Address, ...], routes: RoutingTable
) -> Finding:
    interface, link = near[0].interface, snapshot.link
    assert link is not None
    whose = f"{interface} of the {machine}, which {'leads to the robot at' if machine == 'laptop' else 'has'} {address},"
    switched_off = not near[0].up
    robot = snapshot.robot_fact(ADDRESSES)
    other_off = machine == "laptop" and robot is not None and any(e.address == address and not e.up for e in robot.entries)
    if switched_off:
        where, cause = machine, f"{whose} is switched off"
        fix = FixText(command=command_on(snapshot, machine, f"sudo ip link set {interface} up"))
    elif other_off:
        where, cause = "robot", f"{whose} has no carrier: the robot's interface is switched off"
        fix = set_up_laptop(snapshot, link.address)
    else:
        where = machine if is_tunnel(interface) else "link"
        reason, action = _why_no_carrier(interface, machine, routes)
        cause, fix = f"{whose} has no carrier: {reason}", FixText(instruction=f"{action}, and switch the robot on")
        if link.reachable:
            over = set_up_laptop(snapshot, link.address)
            fix = FixText(
                command=over.get("command", ""),
                instruction=f"{action}; or let ROS 2 use {link.address}, over which SSH works, with the command",
            )
    elsewhere = [f"SSH reaches the robot at {link.address}, which this shell's ROS 2 does not use"] if link.reachable else []
    return make_finding(
        "no-carrier",
        where=where,
        cause=cause,
        evidence=(*(each.line() for each in near), *route_lines(routes, address), *elsewhere),
        # A machine may lose the address of an interface without a carrier.
        explains=OVER_GRAPH | {"robot-unreachable", "link-dead", "shell-wrong-server", *NO_WAY},
        **fix,
    )


def _why_no_carrier(interface: str, machine: str, routes: RoutingTable) -> tuple[str, str]:
    """Return why an interface that is on has no carrier, and what a person does: only some interfaces have a cable."""
    if is_tunnel(interface):
        return "its VPN is not connected", f"connect the VPN of the {machine}"
    if (machine == "laptop" and interface in routes.wireless) or interface.startswith(_WIRELESS):
        return "it is in no WiFi", f"let {interface} of the {machine} join the robot's WiFi again"
    both = " and into the robot" if machine == "laptop" else " and into the laptop"
    return "the cable is unplugged, or its other end is off", f"plug the cable into {interface} of the {machine}{both}"


def route_lines(routes: RoutingTable, address: str) -> list[str]:
    """Return what `ip route get` printed for an address of the robot, as evidence lines."""
    return [f"ip route get {address}: {line}" for line in routes.to_robot.get(address, ())]


CHECKS = (
    Check("link.carrier", find_missing_carrier, laptop=(ADDRESSES, ROUTES, NETWORK_MANAGER), robot=(ADDRESSES,)),
    Check("link.reachable", find_unreachable_robot, laptop=(ADDRESSES, ROUTES)),
)
