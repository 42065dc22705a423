"""How good the link is: round trips over the open connection, lost packets, throughput, and whether multicast passes."""

from __future__ import annotations

import contextlib
import secrets
import shlex
import socket
import statistics
import struct
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING

from lupin_cli.target.base import Script
from lupin_cli.transport import Ping, Quality, jitter_ms, parse_ping

if TYPE_CHECKING:
    import paramiko

    from lupin_cli.target.local import LocalTarget
    from lupin_cli.target.ssh import SshTarget

ROUND_TRIPS, ROUND_TRIPS_S = 40, 6.0
INTERVAL_S = 0.02  # as drive commands come, twice over
PINGS, PING_INTERVAL_S = 15, 0.2  # the shortest interval that ping(1) allows a user; what comes later counts as lost
TRANSFER_S, CHUNK = 1.5, 1 << 16
GROUP, MULTICAST_WAIT_S = "239.255.42.7", 1.5

_ECHO = 'while IFS= read -r line; do echo "$line"; done'
# The robot's half of the multicast test: listens, says what it heard, then speaks.
_FAR = """
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
for _ in range(5):
    s.sendto(word + b" down", (group, port))
    time.sleep(0.05)
"""


class _NotMeasured(Exception):
    """The link is too bad to measure this on it, in the time that there is."""


def measure(target: SshTarget, laptop: LocalTarget, robot_ip: str, laptop_ip: str) -> Quality:
    """All of it, some seconds long. What can't be measured is None; raises Unreachable where the link is gone."""
    ping = pings(laptop, robot_ip)
    rtts: list[float] = []
    down: float | None = None
    up: float | None = None
    passes: tuple[bool | None, bool | None] = (None, None)
    with contextlib.suppress(_NotMeasured):
        rtts = round_trips_ms(target)
    with contextlib.suppress(_NotMeasured):
        passes = multicast(target, robot_ip, laptop_ip)
    with contextlib.suppress(_NotMeasured):
        down = down_mbps(target)
    with contextlib.suppress(_NotMeasured):
        up = up_mbps(target)
    return Quality(
        rtt_ms=statistics.median(rtts) if rtts else None,
        rtt_p95_ms=sorted(rtts)[int(0.95 * (len(rtts) - 1))] if rtts else None,
        jitter_ms=jitter_ms(ping.rtts_ms if ping is not None and len(ping.rtts_ms) > 1 else rtts),
        loss=ping.loss if ping is not None else None,
        down_mbps=down,
        up_mbps=up,
        multicast_down=passes[0],
        multicast_up=passes[1],
    )


@contextlib.contextmanager
def _channel(target: SshTarget, script: str, bound_s: float) -> Iterator[paramiko.Channel]:
    channel = target.open_run(script, bound_s)
    try:
        yield channel
    except (OSError, EOFError) as error:
        raise _NotMeasured from error
    finally:
        channel.close()


def round_trips_ms(target: SshTarget) -> list[float]:
    """The times of some short requests, one after the other, as a shell there answers them; fewer where they take long."""
    times: list[float] = []
    deadline = time.monotonic() + ROUND_TRIPS_S
    with _channel(target, _ECHO, 2 * ROUND_TRIPS_S) as channel:
        while len(times) < ROUND_TRIPS and time.monotonic() < deadline:
            start = time.perf_counter()
            channel.sendall(b"%d\n" % len(times))
            _line(channel)
            times.append((time.perf_counter() - start) * 1e3)
            time.sleep(INTERVAL_S)
    return times


def _line(channel: paramiko.Channel) -> bytes:
    said = b""
    while not said.endswith(b"\n"):
        if not (data := channel.recv(100)):
            raise EOFError("it hung up")
        said += data
    return said


def pings(laptop: LocalTarget, address: str) -> Ping | None:
    """Packets that came back; by ping(1) where this user may not send them, and None where there is no ping either."""
    with contextlib.suppress(OSError):
        return own_pings(address)
    script = f"ping -n -c {PINGS} -i {PING_INTERVAL_S} -W 1 {shlex.quote(address)}"
    bound_s = PINGS * PING_INTERVAL_S + 5
    output = laptop.batch([Script("ping", script, bound_s)], bound_s)["ping"]
    try:
        return parse_ping(output.stdout)
    except ValueError:
        return None


def own_pings(address: str) -> Ping:
    """ICMP echoes (RFC 792) of our own. Raises OSError where the system doesn't let this user send any, or has no way there."""
    try:
        echo = socket.socket(socket.AF_INET, socket.SOCK_DGRAM, socket.IPPROTO_ICMP)
    except PermissionError:  # net.ipv4.ping_group_range leaves us out
        echo = socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_ICMP)
    word, rtts = secrets.token_bytes(16), []
    with echo:
        for number in range(PINGS):
            payload = word + bytes([number])
            start = time.perf_counter()
            echo.sendto(_echo_request(number, payload), (address, 0))
            while (left := start + PING_INTERVAL_S - time.perf_counter()) > 0:
                echo.settimeout(left)
                try:
                    # Request and reply carry the same bytes; on a raw socket the IP header stands before them.
                    answer, sender = echo.recvfrom(2048)
                except TimeoutError:
                    break
                if sender[0] == address and answer.endswith(payload) and answer[-len(payload) - 8] == 0:
                    rtts.append((time.perf_counter() - start) * 1e3)
                    time.sleep(max(0.0, start + PING_INTERVAL_S - time.perf_counter()))
                    break
    return Ping(PINGS, len(rtts), tuple(rtts))


def _echo_request(number: int, payload: bytes) -> bytes:
    body = struct.pack("!HH", 0x4C55, number) + payload
    padded = struct.pack("!BBH", 8, 0, 0) + body + bytes(len(body) % 2)
    total = sum(struct.unpack(f"!{len(padded) // 2}H", padded))
    total = (total & 0xFFFF) + (total >> 16)
    return struct.pack("!BBH", 8, 0, ~(total + (total >> 16)) & 0xFFFF) + body


def down_mbps(target: SshTarget) -> float:
    """Mbit/s from the robot, through the encryption that SSH has and DDS hasn't: a floor, not the wire's rate."""
    with _channel(target, "timeout 5 cat /dev/zero", TRANSFER_S + 5) as channel:
        start, got = time.perf_counter(), 0
        while time.perf_counter() < start + TRANSFER_S and (data := channel.recv(CHUNK)):
            got += len(data)
        return got / (time.perf_counter() - start) * 8e-6


def up_mbps(target: SshTarget) -> float:
    """Mbit/s to the robot, likewise."""
    with _channel(target, "cat >/dev/null; echo end", TRANSFER_S + 10) as channel:
        start, put, chunk = time.perf_counter(), 0, bytes(CHUNK)
        while time.perf_counter() < start + TRANSFER_S:
            channel.sendall(chunk)
            put += len(chunk)
        channel.shutdown_write()
        _line(channel)  # all of it has arrived
        return put / (time.perf_counter() - start) * 8e-6


def multicast(target: SshTarget, robot_ip: str, laptop_ip: str) -> tuple[bool | None, bool | None]:
    """Whether datagrams to a group pass from the robot and to it; None where it has no python3 to tell."""
    if target.batch([Script("python", "command -v python3")])["python"].status != 0:
        return None, None
    word = secrets.token_hex(4)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as near:
        near.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            near.bind((GROUP, 0))
            port = near.getsockname()[1]
            own = socket.inet_aton(laptop_ip)
            near.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, struct.pack("4s4s", socket.inet_aton(GROUP), own))
            near.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, own)
        except OSError:  # no interface with that address, or one that takes no groups
            return None, None
        words = " ".join([GROUP, str(port), robot_ip, word, str(MULTICAST_WAIT_S)])
        with _channel(target, f"exec python3 -c {shlex.quote(_FAR)} {words}", 20.0) as channel:
            try:
                if _line(channel) != b"ready\n":
                    return None, None
                for _ in range(5):
                    near.sendto(f"{word} up".encode(), (GROUP, port))
                    time.sleep(0.05)
                up = _line(channel) == b"heard\n"
            except EOFError:  # it could not join the group
                return None, None
            except OSError:
                up = False
            channel.sendall(b"now\n")
            return _heard(near, f"{word} down".encode()), up


def _heard(near: socket.socket, word: bytes) -> bool:
    deadline = time.monotonic() + MULTICAST_WAIT_S
    while (left := deadline - time.monotonic()) > 0:
        near.settimeout(left)
        try:
            if near.recv(100) == word:
                return True
        except OSError:
            return False
    return False
