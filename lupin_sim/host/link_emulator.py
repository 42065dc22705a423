"""A cable with faults: copies Ethernet frames between two interfaces, with latency, loss and damage.

    link_emulator.py INTERFACE_A INTERFACE_B SETTINGS

It works in user space because many kernels lack sch_netem. SETTINGS is a JSON object: `delay_ms` in each direction,
`jitter_ms` around it (which reorders frames), `loss`, `corrupted` and `duplicated` as fractions of the frames, `rate_mbit_s`
that both directions share, as on WiFi, with a queue of `queue_ms` (a frame that would wait longer is dropped), `multicast`
(whether it passes), and the first and last UDP port of those to which no frame passes: `blocked_ports` from B to A,
`blocked_ports_from_a` from A to B. Prints "running" once it forwards frames.
"""

import heapq
import itertools
import json
import random
import select
import socket
import struct
import sys
import time

# From linux/if_packet.h; Python's socket module lacks them.
SOL_PACKET, ADD_MEMBERSHIP, VNET_HDR, IGNORE_OUTGOING, PROMISCUOUS = 263, 1, 15, 23, 1
ALL_PROTOCOLS = 3
# Each frame comes after a virtio_net_hdr: the checksum and segmentation still to be done. TCP over veth breaks without it.
VNET_HEADER_BYTES = 10
HEADERS_BYTES = 14 + 20 + 8  # of Ethernet, IPv4 and UDP
MAX_FRAMES_PER_WAKEUP = 64
QUEUE_MS = 200.0


def open_interface(name: str) -> socket.socket:
    """Return a raw socket that receives every frame arriving at an interface, and none that leaves it."""
    interface = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ALL_PROTOCOLS))
    interface.setsockopt(SOL_PACKET, VNET_HDR, 1)
    interface.setsockopt(SOL_PACKET, IGNORE_OUTGOING, 1)
    interface.bind((name, ALL_PROTOCOLS))
    interface.setsockopt(SOL_PACKET, ADD_MEMBERSHIP, struct.pack("IHH8s", socket.if_nametoindex(name), PROMISCUOUS, 0, b""))
    interface.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
    interface.setblocking(False)
    return interface


def is_multicast(frame: bytes) -> bool:
    """Return whether the frame is addressed to a group. Broadcasts are not: access points that drop multicast let them pass."""
    return bool(frame[0] & 1) and frame[:6] != b"\xff" * 6


def udp_port(frame: bytes) -> int:
    """Return the destination port of an IPv4 UDP frame; -1 for all other frames."""
    if frame[12:14] != b"\x08\x00" or frame[23:24] != b"\x11":
        return -1
    start = 14 + 4 * (frame[14] & 15)
    return int.from_bytes(frame[start + 2 : start + 4], "big")


def corrupt(frame: bytes) -> bytes:
    """The frame with one bit of its payload flipped, which the receiver's UDP or TCP checksum finds.

    The header then says that the checksum is complete: over veth it usually is still to be done, and nobody would check it.
    """
    position = random.randrange(VNET_HEADER_BYTES + HEADERS_BYTES, len(frame))
    damaged = bytes([frame[position] ^ 1 << random.randrange(8)])
    return bytes(VNET_HEADER_BYTES) + frame[VNET_HEADER_BYTES:position] + damaged + frame[position + 1 :]


class Medium:
    """The air that both directions share: it carries one frame at a time, at `rate_mbit_s`; without a rate, any number."""

    def __init__(self, rate_mbit_s: float, queue_ms: float) -> None:
        self._bytes_per_s = rate_mbit_s * 1e6 / 8
        self._queue_s = queue_ms / 1e3
        self._free_at_s = 0.0

    def send(self, size_bytes: int, now_s: float) -> float | None:
        """Return the time in s at which a frame that arrives now is through; None if the queue is full, so it is dropped."""
        if not self._bytes_per_s:
            return now_s
        start_s = max(now_s, self._free_at_s)
        if start_s - now_s > self._queue_s:
            return None
        self._free_at_s = start_s + size_bytes / self._bytes_per_s
        return self._free_at_s


def main(name_a: str, name_b: str, text: str) -> None:
    """Forward frames until killed."""
    settings = json.loads(text)
    delay_ms, jitter_ms = settings.get("delay_ms", 0.0), settings.get("jitter_ms", 0.0)
    loss, multicast = settings.get("loss", 0.0), settings.get("multicast", True)
    corrupted, duplicated = settings.get("corrupted", 0.0), settings.get("duplicated", 0.0)
    medium = Medium(settings.get("rate_mbit_s", 0.0), settings.get("queue_ms", QUEUE_MS))
    a, b = open_interface(name_a), open_interface(name_b)
    no_port = (0, -1)
    directions = {
        a.fileno(): (a, b, settings.get("blocked_ports_from_a", no_port)),
        b.fileno(): (b, a, settings.get("blocked_ports", no_port)),
    }
    poll = select.poll()
    for fd in directions:
        poll.register(fd, select.POLLIN)
    delayed: list[tuple[float, int, socket.socket, bytes]] = []  # a heap: due time, order, output, frame
    order = itertools.count()
    print("running", flush=True)
    while True:
        now = time.monotonic()
        while delayed and delayed[0][0] <= now:
            _, _, out, frame = heapq.heappop(delayed)
            try:
                out.send(frame)
            except OSError:
                continue  # the interface is down: the frame is lost, as on a cable
        events = poll.poll(max(0.0, delayed[0][0] - now) * 1e3 if delayed else None)
        for fd, _ in events:
            source, out, (first_blocked, last_blocked) = directions[fd]
            now = time.monotonic()  # the delay counts from the frame's arrival; poll() may have waited for long
            for _ in range(MAX_FRAMES_PER_WAKEUP):
                try:
                    frame = source.recv(70000)
                except OSError:
                    break  # nothing more to read, or the interface went down
                ethernet = frame[VNET_HEADER_BYTES:]
                sent_s = medium.send(len(ethernet), now)
                if sent_s is None:
                    continue
                if (loss and random.random() < loss) or (not multicast and is_multicast(ethernet)):
                    continue
                if first_blocked <= udp_port(ethernet) <= last_blocked:
                    continue
                for _ in range(2 if duplicated and random.random() < duplicated else 1):
                    due = sent_s + max(0.0, delay_ms + random.uniform(-jitter_ms, jitter_ms)) / 1e3
                    damaged = corrupted and len(ethernet) > HEADERS_BYTES and random.random() < corrupted
                    heapq.heappush(delayed, (due, next(order), out, corrupt(frame) if damaged else frame))


if __name__ == "__main__":
    main(*sys.argv[1:4])
