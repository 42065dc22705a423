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
    LOST,
    PASSES,
    TAKES_SOME,
    is_limited,
    is_loss,
    losing_machine,
    overwrites,
    shaped_end,
    small_burst,
)
from lupin_cli.checks.drive import SILENT_BUTTON
from lupin_cli.checks.findings import OVER_GRAPH, make_finding
from lupin_cli.checks.layers import EVERYTHING
from lupin_cli.checks.missing_parts import losses_of, signs_of_loss
from lupin_cli.checks.packet_filter import let_packets_pass
from lupin_cli.checks.path_fixes import (
    accept_other_route,
    add_address,
    correct_route,
    let_burst_pass,
    own_addresses,
    resume_or_restart,
    try_another_transport,
)
from lupin_cli.checks.remote_command import FixText, command_on, show_transports
from lupin_cli.checks.robot_address import is_direct
from lupin_cli.facts.addresses import ADDRESSES, is_tunnel
from lupin_cli.facts.graph import GRAPH
from lupin_cli.facts.ros_processes import ROS_PROCESSES
from lupin_cli.facts.sockets import SOCKETS
from lupin_cli.link.path import (
    CLOSED_PORT,
    DDS_BYTES,
    DOWN,
    FRAGMENTED_BYTES,
    LARGE_PING_BYTES,
    NOT_PERMITTED,
    SMALL_BYTES,
    TOO_LONG,
    UP,
    Burst,
    End,
    Path,
)
from lupin_cli.link.path_agent import SILENT
from lupin_runtime.ports import DISCOVERY_PORT

MOSTLY_LOST = 0.5
OFTEN_LOST = 0.2  # of one way: what was heard may not be heard again
BY_CHANCE = "by chance"  # what a finding is about, if so much is lost that all data arrived by chance
LATE_MS = 100.0  # drive commands come every 50 ms
OVER_SSH_MS = 1000.0  # that late, no robot that is only busy answers
ETHERNET_MTU = 1500
_NO_NEIGHBOR = {"No route to host"}  # what a program gets when nobody answers ARP
_ABOVE = OVER_GRAPH | {"robot-unreachable"}
_TO = {UP: "from the laptop to the robot", DOWN: "from the robot to the laptop"}


def find_path_faults(snapshot: Snapshot) -> Iterator[Finding]:
    """Packets do not pass between laptop and robot, in one direction, on some ports or in some sizes; or they come late."""
    path = snapshot.path
    if path is None:
        return
    broken = ground_truth.measure(snapshot).state is ground_truth.State.BROKEN
    if broken:
        for find in (_end_faults, _wrong_neighbors, _dead_link, _silent_robot):
            if faults := [*find(snapshot, path)]:
                break
        if faults:
            yield from faults
            return  # packets that take another way than the data, or none, say nothing about what is above
        yield from _failing_packets(snapshot, path)
        yield from _lost_large_pings(snapshot, path)
        yield from _unanswered_datagrams(snapshot, path)
    yield from _loss_and_delay(snapshot, path, broken)


def _end_faults(snapshot: Snapshot, path: Path) -> Iterator[Finding]:
    """Yield what is wrong with the address or the route of an end; the lower layer if both are."""
    laptop = _address_fault(snapshot, path, path.laptop, path.address) or _route_fault(snapshot, path.laptop, path.address)
    yield from laptop
    if path.robot is not None:
        other = path.laptop.address
        # A laptop that leaves by another interface asks the robot for a way to another address than usual.
        yield from _address_fault(snapshot, path, path.robot, other) or (
            [] if laptop else _route_fault(snapshot, path.robot, other)
        )


def _address_fault(snapshot: Snapshot, path: Path, end: End, other: str) -> list[Finding]:
    """Return a finding if the robot lacks the address in use, or the laptop any address in its network and a route to it."""
    own = own_addresses(snapshot, end.machine)
    if own is None:
        return []
    if end.machine == "robot":
        # Of any scope: it may be link-local. If packets arrive without it, something in between translates.
        addresses = snapshot.robot_fact(ADDRESSES)
        lacks = not (_arrives(path) or (addresses is not None and addresses.has(path.address)))
        what = path.address
    else:
        by_gateway = bool(end.gateway) and (_arrives(path) or not is_direct(snapshot, other))
        lacks = not by_gateway and not any(each.on_same_subnet(other) for each in own)
        lacks = lacks and bool(end.error or end.gateway)
        what = f"an address in the network of {other}, where the other end is"
    if not lacks:
        return []
    return [
        make_finding(
            "address-missing",
            where=end.machine,
            cause=f"no interface of the {end.machine} has {what}",
            evidence=(*(f"{end.machine}: {each.line()}" for each in own), end.line()),
            explains=_ABOVE | {"robot-multi-homed"},
            **add_address(snapshot, path, end.machine, other),
        )
    ]


def _arrives(path: Path) -> bool:
    """Return whether anything of the other end has arrived at this one, or the other way round."""
    return bool(path.ping is not None and path.ping.received) or any(burst.arrived or burst.changed for burst in path.bursts)


def _route_fault(snapshot: Snapshot, end: End, other: str) -> list[Finding]:
    """Return a finding if an end has no route to the other one, or one that leaves by an interface of another network."""
    own = own_addresses(snapshot, end.machine) or ()
    if any(each.address == other for each in own):
        return []  # the machine sends to itself, which is a finding of another check
    near = [each for each in own if each.on_same_subnet(other) and each.up and each.carrier]
    if end.error:
        id, cause = "no-route", f"the {end.machine} has no route to {other}, where the other end is"
    else:
        if not near or any(each.interface == end.interface for each in near):
            return []
        id = "route-elsewhere"
        cause = (
            f"packets of the {end.machine} to {other} leave by {end.interface}, "
            f"although {near[0].interface} has the address {near[0].address} of that network"
        )
    return [
        make_finding(
            id,
            where=end.machine,
            cause=cause,
            evidence=(end.line(), *(f"{end.machine}: {line}" for line in (*(each.line() for each in own), *end.routes))),
            explains=_ABOVE | {"robot-multi-homed"},
            **correct_route(snapshot, end, other, near),
        )
    ]


def _wrong_neighbors(snapshot: Snapshot, path: Path) -> Iterator[Finding]:
    """Yield a finding for an end whose packets go to a hardware address that somebody entered, and that is not the other's."""
    for end, other in ((path.laptop, path.robot), (path.robot, path.laptop)):
        if end is None or not end.neighbor:
            continue
        words = end.neighbor[0].split()
        entered = words[words.index("lladdr") + 1] if "lladdr" in words[:-1] else ""
        if (entered == other.hardware) if other is not None and other.hardware else _arrives(path):
            continue
        address = path.address if end.machine == "laptop" else path.laptop.address
        whose = f"; the other end has {other.hardware}" if other is not None and other.hardware else ""
        yield make_finding(
            "neighbor-wrong",
            where=end.machine,
            cause=f"the {end.machine} sends everything for {address} to {entered or 'nobody'}, a permanent entry{whose}",
            evidence=(f"ip neigh show to {address}: {end.neighbor[0]}", end.line()),
            command=command_on(snapshot, end.machine, f"sudo ip neigh del {address} dev {end.interface}"),
            explains=_ABOVE | {"link-dead", "robot-multi-homed"},
        )


def _dead_link(snapshot: Snapshot, path: Path) -> Iterator[Finding]:
    """Yield a finding if nothing comes in at either end, although both interfaces are up."""
    up, down = small_burst(path, UP), small_burst(path, DOWN)
    if up is None or down is None or (path.ping is not None and path.ping.received):
        return
    if any(
        burst.delivered or (burst.reached or 0) > burst.tried * LOST or set(burst.errors) - _NO_NEIGHBOR for burst in (up, down)
    ):
        return
    yield make_finding(
        "link-dead",
        where="link",
        cause=f"nothing passes between {path.laptop.interface} and {path.robot.interface if path.robot else 'the robot'}, "
        "although both have a carrier: a switch or access point in between, or the radio, is down",
        evidence=(path.laptop.line(), *((path.robot.line(),) if path.robot else ()), up.line(), down.line()),
        explains=_ABOVE,
        **try_another_transport(snapshot),
    )


def _silent_robot(snapshot: Snapshot, path: Path) -> Iterator[Finding]:
    """Yield a finding if the robot answers nothing, although the login failed for a reason of the laptop's own."""
    link, ping = snapshot.link, path.ping
    if link is None or not link.unasked or path.robot is not None or ping is None or path.knock is None:
        return
    if ping.received or path.knock.answered or set(path.answers.values()) - {SILENT}:
        return
    yield make_finding(
        "link-dead",
        where="link",
        cause=f"nothing at {path.address} answers, neither ping nor a datagram nor sshd: the robot is off, or packets to it or "
        "back are lost",
        evidence=(
            path.laptop.line(),
            f"ping {path.address}: {ping.received} of {ping.sent} answered",
            *(f"a datagram to UDP {port} of {path.address}: {answer}" for port, answer in path.answers.items()),
            path.knock.line(),
        ),
        explains=_ABOVE - {"robot-unreachable"},
        **try_another_transport(snapshot),
    )


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
            large += _lost_large(snapshot, path, direction, random_loss)
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
            explains=_ABOVE - {"robot-unreachable"},
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
        explains=_ABOVE - {"robot-unreachable"},
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
        cause=f"{what} {_TO[direction]} is lost {place}; the other direction {otherwise}: {reason}",
        evidence=(
            *(burst.line() for burst in bursts[:4]),
            *((other.line(),) if other is not None else ()),
            *(f"packet filter of the {machine}: {rule}" for rule in rules),
        ),
        # A filter of the robot may also stop what its own programs send to each other.
        explains=_ABOVE | ({f"estop-engaged:{SILENT_BUTTON}"} if machine == "robot" else set()),
        about=f"{direction} on {machine}",
        layer="route" if bursts[0].reverse_path else "",
        **fix,
    )


def _lost_large(snapshot: Snapshot, path: Path, direction: str, random_loss: float) -> Iterator[Finding]:
    for size in (DDS_BYTES, FRAGMENTED_BYTES):
        # A fragmented packet is lost with any of its fragments.
        expected = (1.0 - random_loss) ** (1 if size == DDS_BYTES else 1 + FRAGMENTED_BYTES // DDS_BYTES)
        lost = [burst for burst in path.of(direction, size) if burst.delivered < 0.4 * expected]
        if not lost or expected < 0.5:
            continue
        ends = [end for end in (path.laptop, path.robot) if end is not None]
        by_tunnel = any(is_tunnel(end.interface) for end in ends)
        fragments_pass = size == DDS_BYTES and any(
            burst.delivered >= 0.4 * expected for burst in path.of(direction, FRAGMENTED_BYTES)
        )
        # DDS lets its sender fragment what is larger than the MTU of an interface, which these packets forbid.
        if size == DDS_BYTES and (lost[0].errors.get(TOO_LONG, 0) >= lost[0].tried / 2 or (by_tunnel and fragments_pass)):
            continue
        small = next((end for end in ends if 0 < end.mtu < ETHERNET_MTU and not is_tunnel(end.interface)), None)
        why = f": {small.interface} of the {small.machine} has an MTU of {small.mtu}" if small is not None else ""
        yield make_finding(
            "large-packets-lost",
            where=small.machine if small is not None else losing_machine(path, lost[0]),
            # A smaller MTU in between: senders learn it, unless something takes the ICMP away that tells it.
            severity=Severity.WARNING if fragments_pass else Severity.PROBLEM,
            cause=f"packets of {size} bytes {_TO[direction]} are lost, small ones pass{why}",
            evidence=(lost[0].line(), *(end.line() for end in ends)),
            command=command_on(snapshot, small.machine, f"sudo ip link set {small.interface} mtu {ETHERNET_MTU}")
            if small is not None
            else show_transports(snapshot),
            explains={ground_truth.UNEXPLAINED} if fragments_pass else _ABOVE,
            breaks=() if fragments_pass else (EVERYTHING,),
            about=direction,
        )
        return


def _lost_large_pings(snapshot: Snapshot, path: Path) -> Iterator[Finding]:
    """Yield a finding if large packets get no answer where small ones do: SSH opens its connection, and hears nothing on it."""
    small, large = path.ping, path.large_ping
    if small is None or large is None or large.received or small.loss > 1.0 - MOSTLY_LOST:
        return
    own_mtu = path.laptop.mtu
    is_own = 0 < own_mtu < ETHERNET_MTU and not is_tunnel(path.laptop.interface)
    why = f": {path.laptop.interface} of the laptop has an MTU of {own_mtu}" if is_own else ""
    yield make_finding(
        "large-packets-lost",
        where="laptop" if is_own else "link",
        cause=f"packets of {LARGE_PING_BYTES} bytes get no answer, small ones do{why}",
        evidence=(
            f"ping {path.address}: {small.received} of {small.sent} answered",
            f"ping -s {LARGE_PING_BYTES} {path.address}: {large.received} of {large.sent} answered",
            path.laptop.line(),
        ),
        command=command_on(snapshot, "laptop", f"sudo ip link set {path.laptop.interface} mtu {ETHERNET_MTU}")
        if is_own
        else show_transports(snapshot),
        explains=_ABOVE,
        breaks=(EVERYTHING,),
    )


def _loss_and_delay(snapshot: Snapshot, path: Path, broken: bool) -> Iterator[Finding]:
    """Yield a finding if packets are lost at random, or come late; it is a warning while everything arrives nevertheless."""
    small = {direction: burst for direction in (UP, DOWN) if (burst := small_burst(path, direction))}
    lossy = {direction: burst for direction, burst in small.items() if is_loss(path, direction)}
    losses = {_TO[direction]: 1.0 - burst.delivered for direction, burst in lossy.items()}
    ping = path.ping
    if not small and ping is not None and 0 < ping.received < ping.sent - 1:
        losses = {"there and back": ping.loss}
    rtt_ms = _round_trip_ms(snapshot, path)
    if not losses and rtt_ms < LATE_MS:
        return
    parts = [f"{loss:.0%} of the packets {direction} are lost" for direction, loss in losses.items()]
    paced = [burst for direction in lossy if (burst := path.paced(direction))]
    if any(is_limited(path, burst.direction) and burst.delivered > PASSES for burst in paced):
        parts.append("slowly sent ones pass: something limits their rate")
    parts += [f"a round trip takes {rtt_ms:.0f} ms"] if rtt_ms >= LATE_MS else []
    evidence = [burst.line() for burst in (*small.values(), *paced)]
    if rtt_ms >= OVER_SSH_MS:
        evidence.append(f"the clock was asked over SSH: the answer took {rtt_ms:.0f} ms")
    if ping is not None:
        rtts = ", ".join(f"{rtt:.0f}" for rtt in ping.rtts_ms)
        evidence.append(f"ping {path.address}: {ping.received} of {ping.sent} answered, after {rtts or '-'} ms")
    shaped = shaped_end(path)
    if shaped is not None:
        parts.append(f"a queueing discipline of {shaped.interface} of the {shaped.machine} does it")
        evidence += [f"tc qdisc show dev {shaped.interface}: {line}" for line in shaped.shaping]
    worst = min(lossy.values(), key=lambda burst: burst.delivered, default=None)
    where = shaped.machine if shaped is not None else losing_machine(path, worst) if losses and worst is not None else "link"
    by_rule = any(TAKES_SOME.search(rule) or overwrites(rule) for rule in path.filters.get(where, ()))
    fix = try_another_transport(snapshot)
    if shaped is not None:
        fix = FixText(command=command_on(snapshot, shaped.machine, f"sudo tc qdisc del dev {shaped.interface} root"))
    elif worst is not None and by_rule:
        fix = let_burst_pass(snapshot, path, where, worst, worst.ports)
    # Programs that join meet each other with a burst of packets: they fail at times while those of this visit did not.
    # A ping must pass twice.
    one_way = [1.0 - burst.delivered for burst in lossy.values()] or [1.0 - (1.0 - loss) ** 0.5 for loss in losses.values()]
    most_lost = max(one_way, default=0.0) > MOSTLY_LOST
    is_luck = max(one_way, default=0.0) > OFTEN_LOST
    hinders = broken or most_lost or (snapshot.link is not None and not snapshot.link.reachable)
    yield make_finding(
        "packets-lost",
        where=where,
        severity=Severity.PROBLEM if hinders else Severity.WARNING,
        cause="; ".join(parts),
        evidence=evidence,
        explains=_ABOVE if broken else {"robot-unreachable"},
        breaks=None if broken else (),
        about=BY_CHANCE if is_luck else "",
        **fix,
    )


def _round_trip_ms(snapshot: Snapshot, path: Path) -> float:
    """Return how long a round trip takes: as ping measured it, or as SSH did where ping does not wait long enough."""
    if path.ping is not None and path.ping.rtts_ms:
        return sorted(path.ping.rtts_ms)[len(path.ping.rtts_ms) // 2]
    clock = snapshot.link.clock if snapshot.link is not None else None
    over_ssh_ms = 2e3 * clock.bound_s if clock is not None else 0.0
    return over_ssh_ms if over_ssh_ms >= OVER_SSH_MS else 0.0


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
