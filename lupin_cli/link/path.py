"""The path between this machine and a robot as it was measured from both ends: interfaces, packets sent and counted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from lupin_cli.link.path_agent import KNOCKS
from lupin_cli.link.quality import Ping

SMALL_BYTES, DDS_BYTES, FRAGMENTED_BYTES = 200, 1472, 8000  # 1472: the largest payload that fits Ethernet's MTU of 1500
CLOSED_PORT = 7399  # of no domain: nothing listens there
NOT_PERMITTED = "Operation not permitted"  # what a program gets if a packet filter of its own machine drops what it sends
TOO_LONG = "Message too long"  # for a packet larger than the MTU of its own interface that must not be fragmented
LARGE_PING_BYTES = DDS_BYTES - 4  # a full frame of Ethernet, but for four bytes that a VLAN may take
UP, DOWN = "up", "down"  # to the robot, to the laptop


@dataclass(frozen=True)
class End:
    """One machine's end of the path. `error` is the kernel's answer if it has no route to the other end.

    `neighbor` has the line of `ip neigh` if somebody has entered the other end's hardware address by hand, and `shaping` those
    of `tc qdisc` that delay, drop or limit packets which leave.
    """

    machine: str  # laptop or robot
    interface: str = ""
    address: str = ""
    gateway: str = ""
    mtu: int = 0
    carrier: bool = True
    error: str = ""
    routes: tuple[str, ...] = ()  # of the main table that match the other end's address, as ip(8) prints them
    rules: tuple[str, ...] = ()  # which table is asked, as ip(8) prints them
    hardware: str = ""
    neighbor: Sequence[str] = ()
    shaping: Sequence[str] = ()

    def line(self) -> str:
        """Return the end in one line."""
        if self.error:
            return f"{self.machine}: {self.error}"
        via = f" via {self.gateway}" if self.gateway else ""
        return f"{self.machine}: {self.interface} {self.address}{via}, MTU {self.mtu}{'' if self.carrier else ', no carrier'}"


@dataclass(frozen=True)
class Burst:
    """Packets of one kind, in one direction, to one or several ports.

    `arrived` were received by the sockets; None if only the kernel's counters could be read. `reached` came in at the
    receiver's interface (with other traffic), and its packet filters dropped `filtered`; None if they were not counted.
    """

    direction: str  # up or down
    ports: tuple[int, ...]
    size: int
    sent: int
    arrived: int | None = None
    reordered: int = 0
    errors: Mapping[str, int] = field(default_factory=dict)
    left: int | None = None  # went out at the sender's interface, with other traffic
    reached: int | None = None
    filtered: int | None = None
    reverse_path: int = 0  # dropped because the receiver has another route back (rp_filter)
    silent_ports: tuple[int, ...] = ()  # ports that received nothing although others did
    damaged: int = 0  # came in with a wrong checksum
    changed: int = 0  # came in with other content and no wrong checksum
    unresolved: bool = False  # ARP did not find the receiver: packets may not have left for that reason
    paced: bool = False  # sent slowly, in random order of the ports

    @property
    def tried(self) -> int:
        """How many packets were to be sent."""
        return self.sent + sum(self.errors.values())

    @property
    def delivered(self) -> float:
        """The share that arrived at the sockets, or that no filter took away; 1 if nothing was tried."""
        if not self.tried:
            return 1.0
        if self.arrived is not None:
            return self.arrived / self.tried
        lost = self.tried - self.sent + max(self.filtered or 0, self.tried - (self.reached or 0), 0)
        return max(0.0, 1.0 - lost / self.tried)

    @property
    def sender(self) -> str:
        """The machine that sent."""
        return "laptop" if self.direction == UP else "robot"

    @property
    def receiver(self) -> str:
        """The machine that should have received."""
        return "robot" if self.direction == UP else "laptop"

    def line(self) -> str:
        """Return the burst with all its counters in one line."""
        ports = ", ".join(map(str, self.ports[:8])) + (" …" if len(self.ports) > 8 else "")
        slowly = ", slowly" if self.paced else ""
        counts = [f"{self.tried} packets of {self.size} bytes{slowly} from {self.sender} to {self.receiver}, UDP {ports}"]
        counts += [f"not sent: {name} ({count})" for name, count in self.errors.items()]
        if self.arrived is not None:
            counts.append(f"{self.arrived} arrived")
        if self.left is not None:
            counts.append(f"{self.left} left the {self.sender}'s interface")
        if self.reached is not None:
            counts.append(f"{self.reached} came in at the {self.receiver}'s")
        if self.filtered:
            counts.append(f"{self.filtered} were dropped there before any socket")
        if self.damaged:
            counts.append(f"{self.damaged} came in with a wrong checksum")
        if self.changed:
            counts.append(f"{self.changed} came in with other content")
        if self.unresolved:
            counts.append(f"no machine answered the {self.sender}'s ARP requests")
        if self.silent_ports:
            counts.append(f"nothing on {', '.join(map(str, self.silent_ports))}")
        return "; ".join(counts)


@dataclass(frozen=True)
class UnreadSocket:
    """A socket of DDS whose program does not read it: this many bytes wait, and none are taken."""

    machine: str
    port: int
    waiting: int


@dataclass(frozen=True)
class Knock:
    """What the laptop's own kernel took while connections to the robot's sshd were tried; see `Agent.knock`."""

    unsent: int = 0
    taken: int = 0
    taken_before: int = 0
    answered: int = 0

    @property
    def loses_answers(self) -> bool:
        """Whether packets that came in were dropped, more than without an attempt: the first answer to each connection."""
        return self.taken >= KNOCKS and self.taken > 6 * self.taken_before

    def line(self) -> str:
        """Return the counts in one line."""
        return (
            f"{KNOCKS} connections to sshd: {self.unsent} packets could not leave this machine; "
            f"{self.taken} came in and were dropped before any socket; {self.answered} connections were answered"
        )


@dataclass(frozen=True)
class Path:
    """The path to `address`, as far as it could be measured; `unmeasured` says why the robot's end was not."""

    address: str
    laptop: End
    robot: End | None = None
    bursts: tuple[Burst, ...] = ()
    ping: Ping | None = None
    burst_ping: Ping | None = None  # sent at once, if they were sent
    large_ping: Ping | None = None  # of LARGE_PING_BYTES, if small ones are answered and the robot's end cannot be asked
    answers: Mapping[int, str] = field(default_factory=dict)  # what a datagram to a port of the robot gave: `Agent.answers`
    unread: tuple[UnreadSocket, ...] = ()
    knock: Knock | None = None  # measured only if connections to the robot's sshd time out, or none was tried
    filters: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # machine → rules that drop, as far as readable
    unmeasured: str = ""

    def of(self, direction: str, size: int) -> tuple[Burst, ...]:
        """Return the bursts in a direction with packets of a size."""
        return tuple(burst for burst in self.bursts if (burst.direction, burst.size, burst.paced) == (direction, size, False))

    def paced(self, direction: str) -> Burst | None:
        """Return the burst that was sent slowly in a direction; None if it was not necessary."""
        return next((burst for burst in self.bursts if burst.direction == direction and burst.paced), None)
