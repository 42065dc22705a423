"""The path between laptop and robot, judged by the packets that were sent and counted at both ends.

The path is measured when this machine does not receive all that it should. The lowest layer that fails is the cause, whatever
made it fail; the kernel's counters tell on which machine, or that it lies between the interfaces. Where the robot's end cannot
be asked, the answers of its kernel to single datagrams still tell some of it.
"""

from __future__ import annotations

from collections.abc import Iterator

from lupin_cli.checks import ground_truth
from lupin_cli.checks.base import Check, Finding, Severity, Snapshot
from lupin_cli.checks.burst_losses import (
    LATE_MS,
    LOST,
    MOSTLY_LOST,
    PASSES,
    TO,
    is_limited,
    is_loss,
    losing_machine,
    small_burst,
)
from lupin_cli.checks.drive import SILENT_BUTTON
from lupin_cli.checks.findings import make_finding
from lupin_cli.checks.missing_parts import losses_of, signs_of_loss
from lupin_cli.checks.packet_filter import let_packets_pass
from lupin_cli.checks.path_ends import ABOVE, find_dead_link, find_end_faults, find_silent_robot, find_wrong_neighbors
from lupin_cli.checks.path_fixes import (
    accept_other_route,
    let_burst_pass,
    resume_or_restart,
    try_another_transport,
)
from lupin_cli.checks.path_losses import find_loss_and_delay, find_lost_large, find_lost_large_pings
from lupin_cli.checks.remote_command import show_transports
from lupin_cli.facts.addresses import ADDRESSES
from lupin_cli.facts.graph import GRAPH
from lupin_cli.facts.ros_processes import ROS_PROCESSES
from lupin_cli.facts.sockets import SOCKETS
from lupin_cli.link.path import (
    CLOSED_PORT,
    DOWN,
    NOT_PERMITTED,
    SMALL_BYTES,
    UP,
    Burst,
    Path,
)
from lupin_cli.link.path_agent import SILENT
from lupin_runtime.ports import DISCOVERY_PORT


def find_path_faults(snapshot: Snapshot) -> Iterator[Finding]:
    """Packets do not pass between laptop and robot, in one direction, on some ports or in some sizes; or they come late."""
    path = snapshot.path
    if path is None:
        return
    broken = ground_truth.measure(snapshot).state is ground_truth.State.BROKEN
    if broken:
        for find in (find_end_faults, find_wrong_neighbors, find_dead_link, find_silent_robot):
            if faults := [*find(snapshot, path)]:
                break
        if faults:
            yield from faults
            return  # packets that take another way than the data, or none, say nothing about what is above
        yield from _failing_packets(snapshot, path)
        yield from find_lost_large_pings(snapshot, path)
        yield from _unanswered_datagrams(snapshot, path)
    yield from find_loss_and_delay(snapshot, path, broken)


def _failing_packets(snapshot: Snapshot, path: Path) -> Iterator[Finding]:
    large: list[Finding] = []
    for direction in (UP, DOWN):
        small = small_burst(path, direction)
        if small is None:
            continue
        by_chance = is_loss(path, direction)
        if not by_chance and small.delivered < LOST:
            yield _lost_ports(snapshot, path, direction, [small], "every UDP packet")
            continue
        random_loss = 1.0 - small.delivered if by_chance or not small.silent_ports else 0.0
        in_use = [burst for burst in path.of(direction, SMALL_BYTES) if burst.arrived is None]
        lost = [burst for burst in in_use if burst.delivered < 0.5 * (1.0 - random_loss)]
        if by_chance and small.delivered < MOSTLY_LOST:
            lost = []  # what little arrives says nothing about a port
        if small.silent_ports and not by_chance:
            lost.insert(0, small)
        if lost:
            ports = sorted({port for burst in lost for port in (burst.silent_ports or burst.ports)})
            yield _lost_ports(snapshot, path, direction, lost, f"UDP {', '.join(map(str, ports))}")
        if not is_limited(path, direction):  # a limit of bytes takes more of the large packets
            large += find_lost_large(snapshot, path, direction, random_loss)
    yield from large[:1]  # a small MTU takes large packets away in both directions


def _unanswered_datagrams(snapshot: Snapshot, path: Path) -> Iterator[Finding]:
    """Yield which UDP ports are lost, as far as this machine alone can know: the robot's kernel refuses closed ports."""
    if path.robot is not None or not path.answers:
        return
    lines = tuple(f"a datagram to UDP {port} of {path.address}: {answer}" for port, answer in path.answers.items())
    kept = [port for port, answer in path.answers.items() if answer == NOT_PERMITTED]
    if kept:
        yield make_finding(
            "udp-lost",
            where="laptop",
            cause=f"UDP {', '.join(map(str, kept))} from the laptop to the robot is lost on the laptop: "
            "likely a firewall: its own packets do not leave it",
            evidence=(*lines, *(f"packet filter of the laptop: {rule}" for rule in path.filters.get("laptop", ()))),
            **let_packets_pass(
                snapshot,
                "laptop",
                path.filters.get("laptop", ()),
                kept,
                path.laptop.interface,
                path.address,
                incoming=False,
                own=[path.laptop.address] if path.laptop.address else [],
            ),
            explains=ABOVE - {"robot-unreachable"},
            about=f"{UP} on laptop",
        )
        return
    ping = path.ping
    if ping is None or ping.received < ping.sent - 1 or max(ping.rtts_ms) > LATE_MS or ground_truth.knows_names(snapshot):
        return  # nothing answers, or not always or late: a lower layer fails. With names, the discovery server answers.
    silent = [port for port, answer in path.answers.items() if answer == SILENT]
    graphs = snapshot.laptop.get(GRAPH)
    if silent == [DISCOVERY_PORT] and (graphs is None or all(graph.error for graph in graphs.graphs if graph.kind != "sim")):
        return  # a server answers its clients only, and no program of this machine became one
    if len(silent) == len(path.answers):
        cause = "no UDP packet from the laptop to the robot is answered, not even by its kernel, which answers ping"
    elif silent and CLOSED_PORT not in silent:
        ports = ", ".join(map(str, silent))
        cause = f"UDP {ports} from the laptop to the robot gets no answer, while its kernel refuses UDP {CLOSED_PORT}"
    else:
        return
    reason = "likely a firewall of the robot" + (", or a discovery server that hangs" if silent == [DISCOVERY_PORT] else "")
    yield make_finding(
        "udp-lost",
        where="link",
        cause=f"{cause}: {reason}; the robot could not be asked",
        evidence=(*lines, f"ping {path.address}: {ping.received} of {ping.sent} answered"),
        instruction="look at the packet filter on the robot itself, or use another transport; the command shows which answers",
        command=show_transports(snapshot),
        explains=ABOVE - {"robot-unreachable"},
        about=f"{UP} on link",
    )


def _lost_ports(snapshot: Snapshot, path: Path, direction: str, bursts: list[Burst], what: str) -> Finding:
    machine = losing_machine(path, bursts[0])
    other = small_burst(path, DOWN if direction == UP else UP)
    other_works = other is not None and other.delivered > PASSES
    ends = f"{path.laptop.interface} and {path.robot.interface if path.robot else 'the robot'}"
    if bursts[0].reverse_path:
        place, reason = f"on the {machine}", "its kernel drops them because its route back is another one (rp_filter)"
    elif machine == "link":
        place, reason = f"between {ends}", "likely an access point or a firewall in between"
    else:
        place, reason = f"on the {machine}", "likely a firewall: packets reach its interface and no socket"
        if machine == bursts[0].sender:
            reason = "likely a firewall: its own packets do not leave it"
    rules = path.filters.get(machine, ())
    if bursts[0].reverse_path:
        fix = accept_other_route(snapshot, path, machine)
    elif machine == "link":
        fix = try_another_transport(snapshot)
    else:
        lost = sorted({port for burst in bursts for port in (burst.silent_ports or burst.ports)})
        fix = let_burst_pass(snapshot, path, machine, bursts[0], lost)
    otherwise = "works" if other_works else "fails too"
    return make_finding(
        "udp-lost",
        where=machine,
        cause=f"{what} {TO[direction]} is lost {place}; the other direction {otherwise}: {reason}",
        evidence=(
            *(burst.line() for burst in bursts[:4]),
            *((other.line(),) if other is not None else ()),
            *(f"packet filter of the {machine}: {rule}" for rule in rules),
        ),
        # A filter of the robot may also stop what its own programs send to each other.
        explains=ABOVE | ({f"estop-engaged:{SILENT_BUTTON}"} if machine == "robot" else set()),
        about=f"{direction} on {machine}",
        layer="route" if bursts[0].reverse_path else "",
        **fix,
    )


def find_unread_sockets(snapshot: Snapshot) -> Iterator[Finding]:
    """A program does not take what arrives on its DDS port: it is stopped, or hangs."""
    path, truth = snapshot.path, ground_truth.measure(snapshot)
    if path is None or truth.state is not ground_truth.State.BROKEN:
        return
    for unread in path.unread:
        is_robots = unread.machine == "robot"
        facts = snapshot.robot if is_robots else snapshot.laptop
        sockets = facts.get(SOCKETS) if facts is not None else None
        owners = sockets.on("udp", unread.port) if sockets is not None else ()
        pid = next((each.pid for each in owners if each.pid), 0)
        owner = next((f"{each.process} (process {each.pid})" for each in owners if each.pid), "its program")
        # A program of the laptop keeps no other one from receiving, and one of the robot only its own data.
        program = " ".join(f"{each.process} {each.command}" for each in owners)
        breaks = losses_of(truth, program) if is_robots else ()
        yield make_finding(
            "socket-not-read",
            where=unread.machine,
            cause=f"{owner} does not read UDP {unread.port}: it is stopped or hangs",
            evidence=(f"/proc/net/udp: {unread.waiting} bytes wait on port {unread.port}", *(each.line() for each in owners)),
            about=str(unread.port),
            severity=Severity.PROBLEM if breaks else Severity.WARNING,
            breaks=breaks,
            explains=signs_of_loss(breaks) if truth.heard else (),
            **resume_or_restart(snapshot, unread.machine, pid, unread.port),
        )


PACKETS = "path.packets"
CHECKS = (
    Check(PACKETS, find_path_faults, laptop=(GRAPH, ADDRESSES), robot=(ADDRESSES,)),
    Check("path.sockets", find_unread_sockets, laptop=(GRAPH, SOCKETS), robot=(SOCKETS, ROS_PROCESSES)),
)
