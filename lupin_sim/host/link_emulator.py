"""A cable with faults: copies Ethernet frames between two interfaces, with latency and loss.

    link_emulator.py INTERFACE_A INTERFACE_B SETTINGS

It works in user space because many kernels lack sch_netem. SETTINGS is a JSON object: `delay_ms` in each direction, `jitter_ms`
around it, `loss` as a fraction, `multicast` (whether it passes), and `blocked_ports`: the first and last of the UDP
ports behind A that no frame from B reaches. Prints "running" once it forwards frames.
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
MAX_FRAMES_PER_WAKEUP = 64


def open_interface(name: str) -> socket.socket:
    """A raw socket that receives every frame arriving at an interface, and none that leaves it."""
    interface = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ALL_PROTOCOLS))
    interface.setsockopt(SOL_PACKET, VNET_HDR, 1)
    interface.setsockopt(SOL_PACKET, IGNORE_OUTGOING, 1)
    interface.bind((name, ALL_PROTOCOLS))
    interface.setsockopt(SOL_PACKET, ADD_MEMBERSHIP, struct.pack("IHH8s", socket.if_nametoindex(name), PROMISCUOUS, 0, b""))
    interface.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
    interface.setblocking(False)
    return interface


def is_multicast(frame: bytes) -> bool:
    """Whether the frame is addressed to a group. Broadcasts are not: access points that drop multicast let them pass."""
    return bool(frame[0] & 1) and frame[:6] != b"\xff" * 6


def udp_port(frame: bytes) -> int:
    """The destination port of an IPv4 UDP frame; -1 for all other frames."""
    if frame[12:14] != b"\x08\x00" or frame[23:24] != b"\x11":
        return -1
    start = 14 + 4 * (frame[14] & 15)
    return int.from_bytes(frame[start + 2 : start + 4], "big")


def main(name_a: str, name_b: str, text: str) -> None:
    """Forward frames until killed."""
    settings = json.loads(text)
    delay_ms, jitter_ms = settings.get("delay_ms", 0.0), settings.get("jitter_ms", 0.0)
    loss, multicast = settings.get("loss", 0.0), settings.get("multicast", True)
    first_blocked, last_blocked = settings.get("blocked_ports", (0, -1))
    a, b = open_interface(name_a), open_interface(name_b)
    directions = {a.fileno(): (a, b), b.fileno(): (b, a)}
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
            source, out = directions[fd]
            now = time.monotonic()  # the delay counts from the frame's arrival; poll() may have waited for long
            for _ in range(MAX_FRAMES_PER_WAKEUP):
                try:
                    frame = source.recv(70000)
                except OSError:
                    break  # nothing more to read, or the interface went down
                ethernet = frame[VNET_HEADER_BYTES:]
                if (loss and random.random() < loss) or (not multicast and is_multicast(ethernet)):
                    continue
                if source is b and first_blocked <= udp_port(ethernet) <= last_blocked:
                    continue
                due = now + max(0.0, delay_ms + random.uniform(-jitter_ms, jitter_ms)) / 1e3
                heapq.heappush(delayed, (due, next(order), out, frame))


if __name__ == "__main__":
    main(*sys.argv[1:4])
