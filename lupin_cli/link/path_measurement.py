"""Measures the path between this machine and a robot from both ends at the same time, by packets that are sent and counted.

Packets show every firewall, access point and limit in between, whatever it is called. Those to free ports of DDS participants
are counted by a socket at the other end. Ports of running programs (discovery server, participants) get RTPS headers without
content, which receivers ignore; for them, the kernel's counters at the other end tell how many arrived at the interface and how
many a packet filter took away.
"""

from __future__ import annotations

import contextlib
import secrets
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from lupin_cli.link.path import (
    CLOSED_PORT,
    DDS_BYTES,
    DOWN,
    FRAGMENTED_BYTES,
    LARGE_PING_BYTES,
    NOT_PERMITTED,
    SMALL_BYTES,
    UP,
    Burst,
    End,
    Knock,
    Path,
    UnreadSocket,
)
from lupin_cli.link.path_agent import taken_packets
from lupin_cli.link.path_peers import ChannelOpener, LocalPeer, PathError, Peer, remote_peer
from lupin_cli.link.quality import Ping, ping
from lupin_runtime.ports import DISCOVERY_PORT

if TYPE_CHECKING:
    from lupin_cli.connection.base import Target

FREE_PORTS, PER_PORT = 8, 12
LARGE_PACKETS = 20
BURST = 40  # packets to each port in use: more than other traffic in the same time
PORTS_EXAMINED = 12
FIRST_PARTICIPANT_PORT, LAST_PARTICIPANT_PORT = 7400, 7650
# Without an agent at the other end: a port outside all domains, one that no participant uses, and the discovery server's.
ASKED_PORTS = (CLOSED_PORT, 7599, DISCOVERY_PORT)
PACED_PER_PORT = 3
SOME_LOST = 0.95  # a share of packets below which it is examined what takes the others
ARP_TRIES = 3  # how often a burst is sent whose packets ARP may have taken away
IDLE_S = 0.3
UNREAD_AFTER_S = 0.4  # a program that runs has read its socket by then, even on a busy robot
# A link that loses most packets answers some of them, and one that is very late answers after all.
PINGS, PING_INTERVAL_S, PING_TIMEOUT_S = 20, 0.05, 2.5
LARGE_PINGS = 6


def measure_path(
    laptop: Peer,
    robot: Peer | None,
    address: str,
    pinger: Callable[[], Ping | None],
    on_layer: Callable[[str], None] = lambda _: None,
    sshd: tuple[str, int] | None = None,
) -> Path:
    """Measure the path to the robot's `address`; without `robot`, only what one end can see. Takes about two seconds.

    `on_layer` is called with the name of each layer before it is measured. `sshd` is the address and port of an sshd to which
    no connection could be opened, or none was tried.
    """
    on_layer("route")
    laptop_end = _ask_end("laptop", laptop, address)
    if laptop_end.error or not laptop_end.carrier:
        return Path(address, laptop_end, unmeasured="this machine has no way to the robot's address")
    on_layer("loss")
    path = Path(address, laptop_end)
    with ThreadPoolExecutor(max_workers=1, thread_name_prefix="ping") as pool:
        pinged = pool.submit(pinger)
        if robot is None:
            unmeasured = "the robot's end could not be asked over SSH"
            path = replace(path, answers=_answers(laptop, address), unmeasured=unmeasured)
            if sshd is not None:
                path = replace(path, knock=Knock(**laptop.ask("knock", address=sshd[0], port=sshd[1])))
            if NOT_PERMITTED in path.answers.values():
                path = replace(path, filters={"laptop": tuple(laptop.ask("firewall"))})
        else:
            try:
                path = _measure_both_ends(path, laptop, robot, on_layer)
            except PathError as error:
                path = replace(path, answers=_answers(laptop, address), unmeasured=str(error))
        return replace(path, ping=pinged.result())


def _ask_end(machine: str, peer: Peer, address: str) -> End:
    """Ask a peer for its end of the path to `address`."""
    answer = dict(peer.ask("describe", address=address))
    routes, rules = tuple(answer.pop("routes", ())), tuple(answer.pop("rules", ()))
    return End(machine, routes=routes, rules=rules, **answer)


def _answers(laptop: Peer, address: str) -> dict[int, str]:
    found = laptop.ask("answers", address=address, ports=list(ASKED_PORTS))
    return {int(port): answer for port, answer in found.items()}


def _measure_both_ends(path: Path, laptop: Peer, robot: Peer, on_layer: Callable[[str], None]) -> Path:
    robot_end = _ask_end("robot", robot, path.laptop.address)
    if robot_end.error:
        return replace(path, robot=robot_end)
    peers = {"laptop": laptop, "robot": robot}
    ports = {name: peer.ask("open", count=FREE_PORTS) for name, peer in peers.items()}
    used = {name: _used_ports(peer) for name, peer in peers.items()}
    transmitters = (
        _Transmitter(UP, laptop, robot, path.laptop, robot_end, path.address),
        _Transmitter(DOWN, robot, laptop, robot_end, path.laptop, path.laptop.address),
    )
    with ThreadPoolExecutor(len(transmitters), thread_name_prefix="arp") as pool:
        for resolved in [pool.submit(transmitter.resolve) for transmitter in transmitters]:
            resolved.result()
    bursts: list[Burst] = []
    for transmitter in transmitters:
        direction, receiver, send = transmitter.direction, transmitter.receiver_end.machine, transmitter.send
        on_layer("mtu")
        small = send(ports[receiver], PER_PORT)
        bursts.append(small)
        for size, fragment in ((DDS_BYTES, False), (FRAGMENTED_BYTES, True)):
            bursts.append(send(ports[receiver][:2], LARGE_PACKETS // 2, size, fragment=fragment))
        on_layer("ports")
        if small.delivered < SOME_LOST:
            bursts.append(send(ports[receiver], PACED_PER_PORT, paced=True))
        in_use = sorted(used[receiver])[:PORTS_EXAMINED]
        if in_use:
            together = send(in_use, BURST, counted=False)
            if together.delivered < 0.97 - _loss(bursts, direction):
                transmitter.observe_other_drops()
                bursts += [send([port], BURST, counted=False) for port in in_use]
            else:
                bursts.append(together)
    on_layer("processes")
    unread = tuple(each for name, peer in peers.items() for each in _unread_sockets(name, peer))
    failing = any(burst.delivered < SOME_LOST for burst in bursts)
    filters = {name: tuple(peer.ask("firewall")) for name, peer in peers.items()} if failing else {}
    return replace(path, robot=robot_end, bursts=tuple(bursts), unread=unread, filters=filters)


def _used_ports(peer: Peer) -> dict[int, int]:
    """Return the DDS ports that programs of the machine have bound, with the bytes that wait in each."""
    first, last = FIRST_PARTICIPANT_PORT, LAST_PARTICIPANT_PORT
    found = {**peer.ask("bound", first=first, last=last), **peer.ask("bound", first=DISCOVERY_PORT, last=DISCOVERY_PORT)}
    return {int(port): waiting for port, waiting in found.items()}


def _unread_sockets(machine: str, peer: Peer) -> list[UnreadSocket]:
    """Return the sockets in which data waits that their program does not take. The bursts have put some into each."""
    first = _used_ports(peer)
    time.sleep(UNREAD_AFTER_S)
    second = _used_ports(peer)
    return [UnreadSocket(machine, port, second[port]) for port, waiting in first.items() if 0 < waiting <= second.get(port, 0)]


def _loss(bursts: Sequence[Burst], direction: str) -> float:
    """Return the share of small packets that was lost in a direction, if it is a loss at random."""
    small = [burst for burst in bursts if (burst.direction, burst.size, burst.paced) == (direction, SMALL_BYTES, False)]
    small = [burst for burst in small if burst.arrived]
    return 1.0 - small[0].delivered if small else 0.0


@dataclass
class _Transmitter:
    """Sends packets in one direction of a path; it has the agents of both ends."""

    direction: str
    sender: Peer
    receiver: Peer
    sender_end: End
    receiver_end: End
    address: str  # of the receiver
    resolved: bool = False  # whether ARP has found the receiver
    other_drops_hz: float = 0.0  # packets of other traffic that the receiver drops per second

    def send(
        self,
        ports: Sequence[int],
        number: int,
        size: int = SMALL_BYTES,
        *,
        counted: bool = True,
        fragment: bool = False,
        paced: bool = False,
    ) -> Burst:
        """Send `number` packets to each port, and count what arrives; with `counted`, at sockets that the receiver has opened.

        A burst from which ARP may have taken packets is sent again. It is the last one sent that counts.
        """
        for _ in range(ARP_TRIES):
            burst = self._send_once(ports, number, size, counted, fragment, paced)
            if not self.resolved or self.sender.ask("resolved", **self._hop):
                break
            self.resolve()
        return replace(burst, unresolved=not self.resolved)

    @property
    def _hop(self) -> dict[str, str]:
        return {"hop": self.sender_end.gateway or self.address, "interface": self.sender_end.interface}

    def resolve(self) -> None:
        """Wait until ARP has found the receiver. Raises PathError."""
        self.resolved = self.sender.ask("resolve", address=self.address, **self._hop)

    def observe_other_drops(self) -> None:
        """Count what the receiver drops while nothing is sent to it from here."""
        before = _counters(self.receiver, self.receiver_end)
        time.sleep(IDLE_S)
        after = _counters(self.receiver, self.receiver_end)
        self.other_drops_hz = taken_packets(before, after) / max(_elapsed_s(before, after), IDLE_S)

    def _send_once(self, ports: Sequence[int], number: int, size: int, counted: bool, fragment: bool, paced: bool) -> Burst:
        word = secrets.token_hex(4)
        before = _counters(self.sender, self.sender_end), _counters(self.receiver, self.receiver_end)
        sent, errors = self.sender.ask(
            "send",
            address=self.address,
            ports=list(ports),
            number=number,
            size=size,
            word=word,
            fragment=fragment,
            paced=paced,
        )
        arrived: int | None = None
        reordered, changed, silent = 0, 0, tuple[int, ...]()
        if counted:
            found = {int(port): each for port, each in self.receiver.ask("count", word=word, size=size).items()}
            counts = {port: each for port, each in found.items() if port in ports}
            arrived, reordered, changed = (sum(each[at] for each in counts.values()) for at in range(3))
            silent = tuple(port for port, each in counts.items() if not each[0]) if arrived else ()
        after = _counters(self.sender, self.sender_end), _counters(self.receiver, self.receiver_end, settled=True)
        out = {name: after[0].get(name, 0) - count for name, count in before[0].items()}
        into = {name: after[1].get(name, 0) - count for name, count in before[1].items()}
        others = round(self.other_drops_hz * _elapsed_s(before[1], after[1]))
        return Burst(
            self.direction,
            tuple(ports),
            size,
            sent,
            arrived,
            reordered,
            errors,
            out.get("tx_packets"),
            into.get("rx_packets"),
            max(taken_packets(before[1], after[1]) - others, 0) if into else None,
            into.get("TcpExtIPReversePathFilter", 0),
            silent,
            damaged=into.get("IpInHdrErrors", 0) + into.get("UdpInCsumErrors", 0) + into.get("rx_errors", 0),
            changed=changed,
            paced=paced,
        )


def _elapsed_s(before: Mapping[str, int], after: Mapping[str, int]) -> float:
    return (after.get("uptime_ns", 0) - before.get("uptime_ns", 0)) / 1e9


def _counters(peer: Peer, end: End, *, settled: bool = False) -> dict[str, int]:
    return dict(peer.ask("counters", interface=end.interface, settled=settled)) if end.interface else {}


def measure_from(
    laptop: Target,
    robot: ChannelOpener | None,
    address: str,
    on_layer: Callable[[str], None],
    sshd: tuple[str, int] | None = None,
) -> Path:
    """Measure the path between this machine and a robot, whose end is asked over SSH if it is given; see `measure_path`."""
    from lupin_cli.connection.base import TargetError

    def pinger() -> Ping | None:
        return ping(laptop, address, PINGS, PING_INTERVAL_S, PING_TIMEOUT_S)

    with contextlib.closing(LocalPeer()) as local:
        if robot is None:
            path = measure_path(local, None, address, pinger, on_layer, sshd)
            if path.ping is None or path.ping.loss > 0.5:
                return path
            on_layer("mtu")
            large = ping(laptop, address, LARGE_PINGS, PING_INTERVAL_S, PING_TIMEOUT_S, LARGE_PING_BYTES)
            return replace(path, large_ping=large)
        try:
            with remote_peer(robot) as remote:
                return measure_path(local, remote, address, pinger, on_layer)
        except (TargetError, PathError) as error:
            return replace(measure_path(local, None, address, pinger, on_layer), unmeasured=str(error))
