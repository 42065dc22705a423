"""Addresses that DDS announces: commands to an unreachable one are lost, and one that appeared too late is not announced."""

from __future__ import annotations

from collections.abc import Iterator

from lupin_cli.checks.base import Check, Finding, Snapshot
from lupin_cli.checks.findings import OVER_GRAPH, make_finding
from lupin_cli.checks.packet_evidence import packet_lines
from lupin_cli.checks.remote_command import command_on_robot
from lupin_cli.checks.robot_address import robot_address
from lupin_cli.facts.addresses import ADDRESSES, Address
from lupin_cli.facts.base import Facts
from lupin_cli.facts.dds_profiles import DDS_PROFILES
from lupin_cli.facts.discovery_log import DISCOVERY_LOG
from lupin_cli.facts.ros_processes import ROS_PROCESSES, RosProcess
from lupin_cli.facts.routes import ROUTES
from lupin_cli.facts.sockets import SOCKETS, Socket, Sockets

# RTPS listens on these ports in all possible domains; sockets above them belong to other programs, or only send.
_FIRST_PORT, _LAST_PORT = 7400, 32767
_SHOWN_PROCESSES = 4


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
    announced = addresses.announced
    unroutable = [each for each in announced if not routes.leads_to(each.address)]
    if not unroutable or len(unroutable) == len(announced) or not unrestricted:
        return
    units = [("mirte-ap", log.access_point), ("mirte-wifi-watchdog", log.watchdog)]
    active_units = [f"{name}.service: {state}" for name, state in units if state == "active"]
    command = (
        "sudo systemctl disable --now mirte-ap mirte-wifi-watchdog && sudo reboot"
        if active_units
        else f"sudo ip link set {unroutable[0].interface} down; sudo systemctl restart mirte-ros.service"
    )
    routable = [each for each in announced if each not in unroutable]
    yield make_finding(
        "robot-multi-homed",
        where="robot",
        cause=f"the robot announces {_join_addresses(unroutable)} beside {_join_addresses(routable)}, "
        "and the laptop has no route to the former",
        evidence=(
            *(f"robot: {each.line()}" for each in announced),
            *(f"laptop: {route.line()}" for route in routes.main),
            *active_units,
            *packet_lines(snapshot),
        ),
        command=command_on_robot(snapshot, command),
        explains=OVER_GRAPH,
    )


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
    best = routes.best(address)
    on_laptop = next((each for each in _announced(snapshot.laptop) if best and each.interface == best.device), None)
    if on_laptop is not None:
        yield from _older_processes(snapshot, snapshot.laptop, on_laptop)
    on_robot = next((each for each in _announced(snapshot.robot) if each.address == address), None)
    if on_robot is not None:
        yield from _older_processes(snapshot, snapshot.robot, on_robot)


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
        yield make_finding(
            "process-older-than-interface",
            where=facts.machine,
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
            command=command_on_robot(snapshot, "sudo systemctl restart mirte-ros.service")
            if facts.machine == "robot"
            else f"terminate and start again: {', '.join(str(each.pid) for each in older)}",
            explains=OVER_GRAPH,
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
    ),
    Check("dds.older-than-interface", find_older_than_interface, laptop=(ROUTES, *_FACTS), robot=_FACTS),
)
