"""Addresses that DDS announces: commands to an unreachable one are lost, and one that appeared too late is not announced."""

from __future__ import annotations

from collections.abc import Iterator

from lupin_cli.checks import ground_truth
from lupin_cli.checks.base import Check, Finding, Severity, Snapshot
from lupin_cli.checks.findings import OVER_GRAPH, make_finding
from lupin_cli.checks.missing_parts import describe_programs, losses_of, signs_of_loss
from lupin_cli.checks.packet_evidence import packet_lines
from lupin_cli.checks.remote_command import FixText, command_on_robot, restart_processes, robot_option, service_of
from lupin_cli.checks.robot_address import ACCESS_POINT, robot_address
from lupin_cli.facts.addresses import ADDRESSES, Address, Addresses, is_guest_bridge, is_tunnel
from lupin_cli.facts.base import Facts
from lupin_cli.facts.dds_profiles import DDS_PROFILES
from lupin_cli.facts.discovery_log import DISCOVERY_LOG
from lupin_cli.facts.graph import GRAPH
from lupin_cli.facts.packets import PACKETS
from lupin_cli.facts.ros_processes import ROS_PROCESSES, RosProcess
from lupin_cli.facts.routes import ROUTES, RoutingTable
from lupin_cli.facts.sockets import SOCKETS, Socket, Sockets
from lupin_cli.facts.units import VENDOR

# RTPS listens on these ports in all possible domains; sockets above them belong to other programs, or only send.
_FIRST_PORT, _LAST_PORT = 7400, 32767
_SHOWN_PROCESSES = 4
_ACCESS_POINT_INTERFACE = "wlan0"  # of a stock robot, and the one that single-home looks at


def find_unroutable_address(snapshot: Snapshot) -> Iterator[Finding]:
    """The robot announces an address to which the laptop has no route: data sent there is lost without an error."""
    robot, routes = snapshot.robot, snapshot.laptop.get(ROUTES)
    if robot is None or routes is None:
        return
    addresses, log, processes = robot.get(ADDRESSES), robot.get(DISCOVERY_LOG), robot.get(ROS_PROCESSES)
    if addresses is None or log is None or processes is None:
        return
    whitelists = _whitelists(robot)
    unrestricted = [each for each in processes if not each.is_server and not whitelists.get(each.profile)]
    announced, in_use = addresses.announced, robot_address(snapshot)
    if in_use and not routes.leads_to(in_use):
        return  # a gateway leads to the robot, and perhaps to its other addresses, too
    unroutable = [each for each in announced if not routes.leads_to(each.address)]
    if not unroutable or len(unroutable) == len(announced) or not unrestricted:
        return
    units = [("mirte-ap", log.access_point), ("mirte-wifi-watchdog", log.watchdog)]
    active_units = [f"{name}.service: {state}" for name, state in units if state == "active"]
    routable = [each for each in announced if each not in unroutable]
    at_access_point = [
        each
        for each in unroutable
        if each.interface == _ACCESS_POINT_INTERFACE and (each.address == ACCESS_POINT or log.access_point == "active")
    ]
    by_default = any(routes.best(each.address) is not None for each in unroutable)
    fix = _announce_only(snapshot, addresses, unroutable, routable)
    if at_access_point and active_units:
        fix = FixText(
            command=f"lupin play single-home{robot_option(snapshot)}",
            instruction="the access point is switched off for good and the robot reboots: its stack stops for about a minute",
        )
    lost = not ground_truth.is_answered(ground_truth.measure(snapshot))  # an answered call has reached the robot
    yield make_finding(
        "robot-multi-homed",
        where="robot",
        severity=Severity.PROBLEM if lost else Severity.WARNING,
        symptom="" if lost else "drive commands, arm services and list_controllers may fail, although some are answered now",
        cause=f"the robot announces {_join_addresses(unroutable)} beside {_join_addresses(routable)}, "
        f"and {'only the default route of the laptop leads' if by_default else 'the laptop has no route'} to the former",
        evidence=(
            *(f"robot: {each.line()}" for each in announced),
            *(f"laptop: {route.line()}" for route in routes.main),
            *active_units,
            *packet_lines(snapshot),
        ),
        explains=OVER_GRAPH | {"udp-lost:up on link"} if lost else (),
        breaks=None if lost else (),
        playbook=None if at_access_point else "",
        **fix,
    )


def _announce_only(snapshot: Snapshot, own: Addresses, unroutable: list[Address], routable: list[Address]) -> FixText:
    """Return how the robot announces only the `routable` addresses, without cutting the link that carries the connection.

    An interface of containers, or a tunnel, is another program's. If a tunnel carries the connection, or the address in use is
    translated on the way, nothing shows which interface is below it.
    """
    address = robot_address(snapshot)
    carrier = next((each.interface for each in own.entries if each.address == address), "")
    kept = {carrier, *(each.interface for each in routable)}
    foreign = [each for each in unroutable if is_guest_bridge(each.interface) or is_tunnel(each.interface)]
    commands = [
        f"sudo ip address del {each.address}/{each.prefix_length} dev {each.interface}"
        if each.interface in kept
        else f"sudo ip link set {each.interface} down"
        for each in unroutable
        if each not in foreign and carrier and not is_tunnel(carrier)
    ]
    allowed = " and ".join(("127.0.0.1", *(each.address for each in routable)))
    restrict = f"let the DDS profile of the robot's processes allow only {allowed} (interfaceWhiteList)"
    if not commands:
        return FixText(instruction=f"{restrict}, then restart {VENDOR}")
    script = " && ".join((*dict.fromkeys(commands), f"sudo systemctl restart {VENDOR}"))
    lasting = f"; for {_join_addresses(foreign)}, {restrict}" if foreign else ""
    return FixText(command=command_on_robot(snapshot, script), instruction=f"the command helps until the next boot{lasting}")


def _join_addresses(addresses: list[Address]) -> str:
    return " and ".join(each.address for each in addresses)


def _whitelists(facts: Facts) -> dict[str, tuple[str, ...]]:
    """Return the addresses that each DDS profile restricts its users to, by the profile's path."""
    return {profile.path: profile.whitelist for profile in facts.get(DDS_PROFILES) or ()}


def find_older_than_interface(snapshot: Snapshot) -> Iterator[Finding]:
    """A process started before the link had its address, and neither announces that address nor sends from it.

    A participant opens a sending socket for each address that it finds when it starts (measured with Fast DDS 2.14: all but the
    first, which is loopback). If it listens on all addresses but has no sending socket for one, it is older than that address.
    """
    routes, address = snapshot.laptop.get(ROUTES), robot_address(snapshot)
    if snapshot.robot is None or routes is None or not address or not routes.leads_to(address):
        return
    on_laptop = _source_address(_announced(snapshot.laptop), routes, address)
    if on_laptop is not None:
        yield from _older_processes(snapshot, snapshot.laptop, on_laptop)
    on_robot = next((each for each in _announced(snapshot.robot) if each.address == address), None)
    if on_robot is not None:
        yield from _older_processes(snapshot, snapshot.robot, on_robot)


def _source_address(own: tuple[Address, ...], routes: RoutingTable, address: str) -> Address | None:
    """Return the one of the machine's own addresses from which its packets to `address` come; None if it is not known."""
    route = routes.best(address)
    if route is None:
        return None
    on_interface = [each for each in own if each.interface == route.device]
    chosen = [each for each in on_interface if each.address == route.source]
    return next(iter(chosen or [each for each in on_interface if each.on_same_subnet(route.gateway or address)]), None)


def _announced(facts: Facts) -> tuple[Address, ...]:
    addresses = facts.get(ADDRESSES)
    return addresses.announced if addresses is not None else ()


def _older_processes(snapshot: Snapshot, facts: Facts, address: Address) -> Iterator[Finding]:
    processes, sockets = facts.get(ROS_PROCESSES), facts.get(SOCKETS)
    if processes is None or sockets is None:
        return
    whitelists = _whitelists(facts)
    older = [
        process
        for process in processes
        if not process.is_server
        and not whitelists.get(process.profile)
        and lacks_sending_socket(process, sockets, address.address)
    ]
    if older:
        shown = older[:_SHOWN_PROCESSES]
        truth = ground_truth.measure(snapshot)
        # What the doctor receives, it receives in a process of its own: only a process of the robot takes it away.
        is_robots = facts.machine == "robot"
        of_vendor = any(service_of(each) == VENDOR for each in older)
        losses = losses_of(truth, describe_programs(older), in_vendor_unit=of_vendor) if is_robots else ()
        is_problem = bool(losses) if is_robots else truth.state is not ground_truth.State.HEALTHY
        yield make_finding(
            "process-older-than-interface",
            where=facts.machine,
            severity=Severity.PROBLEM if is_problem else Severity.WARNING,
            cause=f"{', '.join(each.name for each in shown)} started before {address.interface} had {address.address}: "
            "their DDS does not use that address",
            evidence=(
                address.line(),
                *(
                    f"{each.name} (process {each.pid}, {each.age_s:.0f} s old): {socket.line()}"
                    for each in shown
                    for socket in _sending_sockets(each, sockets)
                ),
            ),
            explains=signs_of_loss(losses),
            breaks=losses,
            **restart_processes(snapshot, facts.machine, older),
        )


def _sending_sockets(process: RosProcess, sockets: Sockets) -> list[Socket]:
    return [each for each in sockets.of(process.pid) if each.protocol == "udp" and each.port > _LAST_PORT]


def lacks_sending_socket(process: RosProcess, sockets: Sockets, address: str) -> bool:
    """Return whether `process` listens for DDS on all addresses, sends from some, and has no socket on `address`."""
    bound = [each for each in sockets.of(process.pid) if each.protocol == "udp"]
    listens = any(each.is_wildcard and _FIRST_PORT <= each.port <= _LAST_PORT for each in bound)
    senders = _sending_sockets(process, sockets)
    return listens and bool(senders) and not any(each.address == address for each in senders)


_FACTS = (ADDRESSES, ROS_PROCESSES, SOCKETS, DDS_PROFILES)
CHECKS = (
    Check(
        "dds.multi-homed",
        find_unroutable_address,
        laptop=(ROUTES,),
        robot=(ADDRESSES, DISCOVERY_LOG, ROS_PROCESSES, DDS_PROFILES),
        followup_laptop=(GRAPH, PACKETS),  # the visit causes the packets that are captured
        followup_robot=(PACKETS,),
    ),
    Check("dds.older-than-interface", find_older_than_interface, laptop=(ROUTES, *_FACTS), robot=_FACTS),
)
