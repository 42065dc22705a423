"""Addresses that DDS announces: one that nobody can reach swallows commands, one that came too late is never announced."""

from __future__ import annotations

from collections.abc import Iterator

from lupin_cli.checks.base import Check, Evidence, Finding, Fix, Severity
from lupin_cli.checks.capture import packet_lines
from lupin_cli.checks.consequences import SEEN_OVER_THE_GRAPH
from lupin_cli.checks.typed import on_robot
from lupin_cli.checks.way import robot_address
from lupin_cli.facts.addresses import ADDRESSES, Address
from lupin_cli.facts.base import Facts
from lupin_cli.facts.dds_profiles import DDS_PROFILES
from lupin_cli.facts.discovery_log import DISCOVERY_LOG
from lupin_cli.facts.ros_processes import ROS_PROCESSES, RosProcess
from lupin_cli.facts.routes import ROUTES
from lupin_cli.facts.sockets import SOCKETS, Sockets

# RTPS ports of all domains that a machine can have; sockets beyond are of other programs, or for sending.
_FIRST_PORT, _LAST_PORT = 7400, 32767


def find_unroutable(evidence: Evidence) -> Iterator[Finding]:
    """The robot announces an address that no route of this machine leads to: data to it lands nowhere, in silence."""
    robot, routes = evidence.robot, evidence.laptop.get(ROUTES)
    if robot is None or routes is None:
        return
    addresses, log, processes = robot.get(ADDRESSES), robot.get(DISCOVERY_LOG), robot.get(ROS_PROCESSES)
    if addresses is None or log is None or processes is None:
        return
    whitelist = {profile.path: profile.whitelist for profile in robot.get(DDS_PROFILES) or ()}
    talkers = [process for process in processes if not process.is_server]
    free = [process for process in talkers if not whitelist.get(process.profile)]
    announced = addresses.announced
    lost = [each for each in announced if not routes.leads_to(each.address)]
    if not lost or len(lost) == len(announced) or not free:
        return
    units = [("mirte-ap", log.access_point), ("mirte-wifi-watchdog", log.watchdog)]
    up = [f"{name}.service: {state}" for name, state in units if state == "active"]
    fix = (
        "sudo systemctl disable --now mirte-ap mirte-wifi-watchdog && sudo reboot"
        if up
        else f"sudo ip link set {lost[0].interface} down; sudo systemctl restart mirte-ros.service"
    )
    yield Finding(
        id="robot-multi-homed",
        severity=Severity.PROBLEM,
        where="robot",
        symptom="telemetry comes, commands go nowhere: the base won't drive, arm services and list_controllers time out",
        cause=f"the robot announces {_names(lost)} beside {_names([e for e in announced if e not in lost])}, "
        "and this machine has no route there",
        evidence=(
            *(f"robot: {each.line()}" for each in announced),
            *(f"laptop: {route.line()}" for route in routes.main),
            *up,
            *packet_lines(evidence),
        ),
        fix=Fix(on_robot(evidence, fix), playbook="single-home"),
        explains=SEEN_OVER_THE_GRAPH,
    )


def _names(addresses: list[Address]) -> str:
    return " and ".join(each.address for each in addresses)


def find_older_than_interface(evidence: Evidence) -> Iterator[Finding]:
    """Processes that were started before the address of the link was there: they neither announce it nor send from it.

    A participant opens a sending socket per address that it finds when it starts (measured with Fast DDS 2.14: all but the
    first, which is loopback), so one that listens everywhere and has none for an address is older than that address.
    """
    routes, address = evidence.laptop.get(ROUTES), robot_address(evidence)
    if routes is None or not address or not routes.leads_to(address):
        return
    best = routes.best(address)
    here = next((each for each in _announced(evidence.laptop) if best and each.interface == best.device), None)
    if here is not None and evidence.robot is not None:
        yield from _older(evidence, evidence.laptop, here)
    there = next((each for each in _announced(evidence.robot) if each.address == address), None)
    if evidence.robot is not None and there is not None:
        yield from _older(evidence, evidence.robot, there)


def _announced(facts: Facts | None) -> tuple[Address, ...]:
    addresses = facts.get(ADDRESSES) if facts is not None else None
    return addresses.announced if addresses is not None else ()


def _older(evidence: Evidence, facts: Facts, address: Address) -> Iterator[Finding]:
    processes, sockets = facts.get(ROS_PROCESSES), facts.get(SOCKETS)
    if processes is None or sockets is None:
        return
    whitelist = {profile.path: profile.whitelist for profile in facts.get(DDS_PROFILES) or ()}
    old = [
        process
        for process in processes
        if not process.is_server and not whitelist.get(process.profile) and misses(process, sockets, address.address)
    ]
    if old:
        yield Finding(
            id="process-older-than-interface",
            severity=Severity.PROBLEM,
            where=facts.machine,
            symptom="nodes are listed, and nothing comes from them over this link",
            cause=f"{', '.join(each.name for each in old[:4])} started before {address.interface} had {address.address}: "
            "their DDS knows nothing of it",
            evidence=(
                address.line(),
                *(
                    f"{each.name} (process {each.pid}, {each.age_s:.0f} s old): {socket.line()}"
                    for each in old[:4]
                    for socket in _senders(each, sockets)
                ),
            ),
            fix=Fix(
                on_robot(evidence, "sudo systemctl restart mirte-ros.service")
                if facts.machine == "robot"
                else f"end and start again: {', '.join(str(each.pid) for each in old)}"
            ),
            explains=SEEN_OVER_THE_GRAPH,
        )


def _senders(process: RosProcess, sockets: Sockets) -> list:
    return [each for each in sockets.of(process.pid) if each.protocol == "udp" and each.port > _LAST_PORT]


def misses(process: RosProcess, sockets: Sockets, address: str) -> bool:
    """Whether `process` listens for DDS everywhere, sends from somewhere, and has no socket on `address`."""
    bound = [each for each in sockets.of(process.pid) if each.protocol == "udp"]
    listens = any(each.anywhere and _FIRST_PORT <= each.port <= _LAST_PORT for each in bound)
    sends = _senders(process, sockets)
    return listens and bool(sends) and not any(each.address == address for each in sends)


_BOTH = (ADDRESSES, ROS_PROCESSES, SOCKETS, DDS_PROFILES)
CHECKS = (
    Check("dds.multi-homed", find_unroutable, (ROUTES,), (ADDRESSES, DISCOVERY_LOG, ROS_PROCESSES, DDS_PROFILES)),
    Check("dds.older-than-interface", find_older_than_interface, (ROUTES, *_BOTH), _BOTH),
)
