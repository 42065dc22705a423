"""Measures the link to a robot: round trips over the open connection, packet loss, throughput, and whether multicast passes."""

from __future__ import annotations

import contextlib
import itertools
import re
import secrets
import shlex
import socket
import statistics
import struct
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from lupin_cli.connection.base import Script, Target

if TYPE_CHECKING:
    import paramiko
    from icmplib import ICMPRequest, ICMPv4Socket

    from lupin_cli.connection.ssh import SshTarget

ROUND_TRIPS, ROUND_TRIPS_S = 40, 6.0
ROUND_TRIP_INTERVAL_S = 0.02  # twice the rate of drive commands
_ECHO_REPLY = 0  # ICMP's type
BURST_PINGS, BURST_PING_BYTES, BURST_TIMEOUT_S = 40, 400, 0.5
PING_BYTES = 56  # without the headers of ICMP and IP: what ping(1) sends
PINGS, PING_INTERVAL_S = 15, 0.2  # the shortest interval that ping(1) allows an ordinary user; later replies count as lost
TRANSFER_S, CHUNK_BYTES = 1.5, 1 << 16
MULTICAST_GROUP, MULTICAST_WAIT_S = "239.255.42.7", 1.5
MULTICAST_DATAGRAMS, MULTICAST_INTERVAL_S = 5, 0.05

_ECHO = 'while IFS= read -r line; do echo "$line"; done'
# The robot's half of the multicast test: it listens, reports whether it heard a datagram, then sends its own.
_ROBOT_MULTICAST = f"""
import socket, struct, sys, time
group, port, own, word, wait = sys.argv[1], int(sys.argv[2]), sys.argv[3], sys.argv[4].encode(), float(sys.argv[5])
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
s.bind((group, port))
s.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(group) + socket.inet_aton(own))
s.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(own))
s.settimeout(wait)
print("ready", flush=True)
end = time.monotonic() + wait
heard = False
while not heard and time.monotonic() < end:
    try:
        heard = s.recv(100) == word + b" up"
    except OSError:
        break
print("heard" if heard else "nothing", flush=True)
sys.stdin.readline()
for _ in range({MULTICAST_DATAGRAMS}):
    s.sendto(word + b" down", (group, port))
    time.sleep({MULTICAST_INTERVAL_S})
"""


@dataclass(frozen=True)
class Ping:
    """ICMP echo requests and their replies."""

    sent: int
    received: int
    rtts_ms: tuple[float, ...]

    @property
    def loss(self) -> float:
        """The share of requests without a reply, 0 to 1."""
        return 1.0 - self.received / self.sent if self.sent else 0.0


@dataclass(frozen=True)
class Quality:
    """The measured link; None for each value that could not be measured."""

    rtt_ms: float | None = None  # median; of a request of a few bytes over the open connection
    rtt_p95_ms: float | None = None
    jitter_ms: float | None = None
    loss: float | None = None
    down_mbps: float | None = None  # robot → laptop
    up_mbps: float | None = None
    multicast_down: bool | None = None
    multicast_up: bool | None = None


class _NotMeasured(Exception):
    """The link is too bad for this measurement."""


def measure(target: SshTarget, laptop: Target, robot_ip: str, laptop_ip: str) -> Quality:
    """Measure everything, which takes some seconds. Raises Unreachable if the robot can no longer be reached."""
    pings = ping(laptop, robot_ip)
    rtts: list[float] = []
    down: float | None = None
    up: float | None = None
    multicast_down: bool | None = None
    multicast_up: bool | None = None
    with contextlib.suppress(_NotMeasured):
        rtts = round_trips_ms(target)
    with contextlib.suppress(_NotMeasured):
        multicast_down, multicast_up = multicast(target, robot_ip, laptop_ip)
    with contextlib.suppress(_NotMeasured):
        down = down_mbps(target)
    with contextlib.suppress(_NotMeasured):
        up = up_mbps(target)
    return Quality(
        rtt_ms=statistics.median(rtts) if rtts else None,
        rtt_p95_ms=sorted(rtts)[int(0.95 * (len(rtts) - 1))] if rtts else None,
        jitter_ms=jitter_ms(pings.rtts_ms if pings is not None and len(pings.rtts_ms) > 1 else rtts),
        loss=pings.loss if pings is not None else None,
        down_mbps=down,
        up_mbps=up,
        multicast_down=multicast_down,
        multicast_up=multicast_up,
    )


@contextlib.contextmanager
def _channel(target: SshTarget, script: str, timeout_s: float) -> Iterator[paramiko.Channel]:
    channel = target.open_run(script, timeout_s)
    try:
        yield channel
    except (OSError, EOFError) as error:
        raise _NotMeasured from error
    finally:
        channel.close()


def _read_line(channel: paramiko.Channel) -> bytes:
    line = b""
    while not line.endswith(b"\n"):
        if not (data := channel.recv(100)):
            raise EOFError("the robot closed the channel")
        line += data
    return line


# -- round trips and packets


def round_trips_ms(target: SshTarget) -> list[float]:
    """Measure up to ROUND_TRIPS short requests to a shell on the robot, one after the other; fewer on a slow link."""
    durations: list[float] = []
    deadline = time.monotonic() + ROUND_TRIPS_S
    with _channel(target, _ECHO, 2 * ROUND_TRIPS_S) as channel:
        while len(durations) < ROUND_TRIPS and time.monotonic() < deadline:
            start = time.perf_counter()
            channel.sendall(b"%d\n" % len(durations))
            _read_line(channel)
            durations.append((time.perf_counter() - start) * 1e3)
            time.sleep(ROUND_TRIP_INTERVAL_S)
    return durations


def ping(
    laptop: Target,
    address: str,
    count: int = PINGS,
    interval_s: float = PING_INTERVAL_S,
    timeout_s: float = PING_INTERVAL_S,
    payload_bytes: int = PING_BYTES,
) -> Ping | None:
    """Ping an IPv4 address from this machine with so many bytes; None if this user cannot ping at all.

    Requests do not wait for the replies to earlier ones; a reply more than `timeout_s` after its request counts as lost.
    Opening an ICMP socket requires net.ipv4.ping_group_range or CAP_NET_RAW. Without either, ping(1) is used.
    """
    import icmplib

    for privileged in (False, True):
        with contextlib.suppress(icmplib.ICMPLibError), icmplib.ICMPv4Socket(privileged=privileged) as opened:
            if found := _echo(opened, address, count, interval_s, timeout_s, payload_bytes):
                return found
    interval_s = max(interval_s, PING_INTERVAL_S)
    script = f"ping -n -c {count} -i {interval_s} -W {max(1, round(timeout_s))} -s {payload_bytes} {shlex.quote(address)}"
    limit_s = count * interval_s + 5
    output = laptop.batch([Script("ping", script, limit_s)], limit_s)["ping"]
    try:
        return parse_ping(output.stdout)
    except ValueError:
        return None


def echo_burst(address: str) -> Ping | None:
    """Ping an IPv4 address with packets that are sent at once; None if this user cannot, as ping(1) sends them too slowly.

    It loses some where a link passes single packets, but not the burst with which DDS programs that join meet the others.
    """
    import icmplib

    for privileged in (False, True):
        with contextlib.suppress(icmplib.ICMPLibError), icmplib.ICMPv4Socket(privileged=privileged) as opened:
            if found := _echo(opened, address, BURST_PINGS, 0.0, BURST_TIMEOUT_S, BURST_PING_BYTES):
                return found
    return None


def _echo(
    opened: ICMPv4Socket, address: str, count: int, interval_s: float, timeout_s: float, payload_bytes: int
) -> Ping | None:
    """Send the requests and take the replies meanwhile; None if none could be sent, because there is no route."""
    import icmplib
    from icmplib.utils import unique_identifier

    identifier = unique_identifier()
    sent: dict[int, ICMPRequest] = {}
    rtts_ms: dict[int, float] = {}

    def take_replies(until_s: float, *, all_sent: bool) -> None:
        while (remaining_s := until_s - time.monotonic()) > 0 and not (all_sent and len(rtts_ms) == len(sent)):
            with contextlib.suppress(icmplib.ICMPLibError):  # nothing came, or an error about one of the requests
                reply = opened.receive(None, remaining_s)
                request = sent.get(reply.sequence)
                if request is None or reply.id != request.id or (reply.type, reply.source) != (_ECHO_REPLY, address):
                    continue
                if (rtt_ms := (reply.time - request.time) * 1e3) <= timeout_s * 1e3:
                    rtts_ms.setdefault(reply.sequence, rtt_ms)

    for sequence in range(count):
        request = icmplib.ICMPRequest(address, identifier, sequence, payload_size=payload_bytes)
        with contextlib.suppress(icmplib.ICMPLibError):
            opened.send(request)
            sent[sequence] = request
        if sequence + 1 < count:
            take_replies(time.monotonic() + interval_s, all_sent=False)
    if not sent:
        return None
    take_replies(time.monotonic() + timeout_s, all_sent=True)
    return Ping(count, len(rtts_ms), tuple(rtts_ms[sequence] for sequence in sorted(rtts_ms)))


def parse_ping(text: str) -> Ping:
    """Parse the output of `ping -n` of iputils or busybox. Raises ValueError."""
    counts = re.search(r"(\d+) packets transmitted, (\d+) (?:packets )?received", text)
    if counts is None:
        raise ValueError(f"expected the output of ping, found {text.strip()[:80]!r}")
    rtts = tuple(float(found) for found in re.findall(r"\btime=([\d.]+) ?ms", text))
    return Ping(int(counts[1]), int(counts[2]), rtts)


def jitter_ms(rtts_ms: Sequence[float]) -> float | None:
    """Return the mean difference of consecutive round trips, which RFC 3550 (6.4.1) calls jitter; None for fewer than two."""
    if len(rtts_ms) < 2:
        return None
    return statistics.fmean(abs(after - before) for before, after in itertools.pairwise(rtts_ms))


# -- throughput


def down_mbps(target: SshTarget) -> float:
    """Measure Mbit/s from the robot over SSH. DDS can be faster, since it does not encrypt: this is a lower bound."""
    with _channel(target, "timeout 5 cat /dev/zero", TRANSFER_S + 5) as channel:
        start, received = time.perf_counter(), 0
        while time.perf_counter() < start + TRANSFER_S and (data := channel.recv(CHUNK_BYTES)):
            received += len(data)
        return received / (time.perf_counter() - start) * 8e-6


def up_mbps(target: SshTarget) -> float:
    """Measure Mbit/s to the robot over SSH: a lower bound, as in `down_mbps`."""
    with _channel(target, "cat >/dev/null; echo end", TRANSFER_S + 10) as channel:
        start, sent, chunk = time.perf_counter(), 0, bytes(CHUNK_BYTES)
        while time.perf_counter() < start + TRANSFER_S:
            channel.sendall(chunk)
            sent += len(chunk)
        channel.shutdown_write()
        _read_line(channel)  # the robot has received everything
        return sent / (time.perf_counter() - start) * 8e-6


# -- multicast


def multicast(target: SshTarget, robot_ip: str, laptop_ip: str) -> tuple[bool | None, bool | None]:
    """Return whether multicast passes from the robot, and to it; (None, None) if one of the machines cannot take part."""
    if target.batch([Script("python", "command -v python3")])["python"].status != 0:
        return None, None
    word = secrets.token_hex(4)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as local:
        local.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            local.bind((MULTICAST_GROUP, 0))
            port = local.getsockname()[1]
            own = socket.inet_aton(laptop_ip)
            membership = struct.pack("4s4s", socket.inet_aton(MULTICAST_GROUP), own)
            local.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
            local.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, own)
        except OSError:  # no interface has that address, or it does not support multicast
            return None, None
        arguments = " ".join([MULTICAST_GROUP, str(port), robot_ip, word, str(MULTICAST_WAIT_S)])
        with _channel(target, f"exec python3 -I -c {shlex.quote(_ROBOT_MULTICAST)} {arguments}", 20.0) as channel:
            try:
                if _read_line(channel) != b"ready\n":
                    return None, None
                for _ in range(MULTICAST_DATAGRAMS):
                    local.sendto(f"{word} up".encode(), (MULTICAST_GROUP, port))
                    time.sleep(MULTICAST_INTERVAL_S)
                up = _read_line(channel) == b"heard\n"
            except EOFError:  # the robot could not join the group
                return None, None
            except OSError:
                up = False
            channel.sendall(b"now\n")
            return _receives(local, f"{word} down".encode()), up


def _receives(local: socket.socket, datagram: bytes) -> bool:
    deadline = time.monotonic() + MULTICAST_WAIT_S
    while (remaining_s := deadline - time.monotonic()) > 0:
        local.settimeout(remaining_s)
        try:
            if local.recv(100) == datagram:
                return True
        except OSError:
            return False
    return False
