"""A cable with faults, in user space, since many kernels come without sch_netem: frames from one port to another and back.

    pump.py PORT_A PORT_B SETTINGS

Settings, a JSON object: delay_ms each way, jitter_ms around it, loss as a share of 1, multicast, and deaf_ports: UDP ports of
A's side, first and last, that no frame from B reaches. Prints one line when it works.
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

# linux/if_packet.h, which Python's socket module leaves out.
SOL_PACKET, ADD_MEMBERSHIP, VNET_HDR, IGNORE_OUTGOING, PROMISCUOUS = 263, 1, 15, 23, 1
ALL_PROTOCOLS = 3
VNET_HEADER = 10  # before each frame: what is left to do of checksum and segmentation, without which TCP breaks on veth
BATCH = 64


def port(name: str) -> socket.socket:
    """Everything that arrives at an interface, and nothing that leaves it."""
    end = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ALL_PROTOCOLS))
    end.setsockopt(SOL_PACKET, VNET_HDR, 1)
    end.setsockopt(SOL_PACKET, IGNORE_OUTGOING, 1)
    end.bind((name, ALL_PROTOCOLS))
    end.setsockopt(SOL_PACKET, ADD_MEMBERSHIP, struct.pack("IHH8s", socket.if_nametoindex(name), PROMISCUOUS, 0, b""))
    end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
    end.setblocking(False)
    return end


def is_multicast(frame: bytes) -> bool:
    """Of a group; broadcasts pass everywhere."""
    return bool(frame[0] & 1) and frame[:6] != b"\xff" * 6


def udp_port(frame: bytes) -> int:
    """Where an IPv4 UDP frame goes; -1 for all others."""
    if frame[12:14] != b"\x08\x00" or frame[23:24] != b"\x11":
        return -1
    start = 14 + 4 * (frame[14] & 15)
    return int.from_bytes(frame[start + 2 : start + 4], "big")


def main(name_a: str, name_b: str, text: str) -> None:
    """Pump until killed."""
    settings = json.loads(text)
    delay_ms, jitter_ms = settings.get("delay_ms", 0.0), settings.get("jitter_ms", 0.0)
    loss, multicast = settings.get("loss", 0.0), settings.get("multicast", True)
    first_deaf, last_deaf = settings.get("deaf_ports", (0, -1))
    a, b = port(name_a), port(name_b)
    ends = {a.fileno(): (a, b), b.fileno(): (b, a)}
    ready = select.poll()
    for fd in ends:
        ready.register(fd, select.POLLIN)
    waiting: list[tuple[float, int, socket.socket, bytes]] = []
    order = itertools.count()
    print("pumping", flush=True)
    while True:
        now = time.monotonic()
        while waiting and waiting[0][0] <= now:
            _, _, out, frame = heapq.heappop(waiting)
            try:
                out.send(frame)
            except OSError:
                continue  # its interface is down: the frame is lost, as on a cable
        events = ready.poll(max(0.0, waiting[0][0] - now) * 1e3 if waiting else None)
        now = time.monotonic()
        for fd, _ in events:
            source, out = ends[fd]
            now = time.monotonic()  # the wait may have been long: a frame is late from its arrival, not from before
            for _ in range(BATCH):
                try:
                    frame = source.recv(70000)
                except OSError:
                    break  # nothing more, or the interface went down
                bare = frame[VNET_HEADER:]
                if (loss and random.random() < loss) or (not multicast and is_multicast(bare)):
                    continue
                if source is b and first_deaf <= udp_port(bare) <= last_deaf:
                    continue
                due = now + max(0.0, delay_ms + random.uniform(-jitter_ms, jitter_ms)) / 1e3
                heapq.heappush(waiting, (due, next(order), out, frame))


if __name__ == "__main__":
    main(*sys.argv[1:4])
