"""One end of the path between two machines: sends and counts UDP datagrams, and reads the kernel's counters.

This file also runs on the robot, as `python3 -c`: it needs only Python 3.8 and no root, and imports nothing of Lupin. It
answers every line of JSON on its standard input, `{"do": METHOD, ...}`, with one line on its standard output.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import random
import re
import select
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

# An RTPS header without submessages: receivers of DDS ignore it, and a firewall cannot tell it from their own packets.
RTPS_HEADER = b"RTPS\x02\x03\x01\x0fLUPINPATHTST"
PARTICIPANT_PORTS = range(7410, 7600)  # RTPS 2.2, 9.6.1.1: unicast ports of domain 0
REFUSED, SILENT, ANSWERED, UNCLEAR = "refused", "silent", "answered", "unclear"  # what the other machine does with a datagram
# From linux/in.h; Python's socket module lacks them. PROBE sets DF and ignores the path MTU that the kernel has learned.
IP_MTU_DISCOVER, IP_PMTUDISC_DONT, IP_PMTUDISC_PROBE = 10, 0, 3
INTERVAL_S = 0.001
ICMP_WAIT_S = 1.05
ARRIVAL_S = 0.05  # the last packets may be this much later than the request to count them
SETTLE_S, SETTLE_READS, SETTLE_PACKETS = 0.03, 10, 3  # other traffic goes on meanwhile
PACE_S = 0.04  # between packets that are sent slowly: less traffic than one topic has
IDLE_S, KNOCK_S, KNOCKS = 0.5, 1.5, 3  # KNOCK_S: the kernel sends the first packet of a TCP connection again after a second
RESOLVE_S, RESOLVE_POLL_S = 5.0, 0.05  # ARP asks once a second, and a lossy link takes most questions or answers away
DISCARD_PORT = 9
SHOWN_RULES = 12
ETHERNET, NO_ARP, COMPLETE = 1, 0x80, 0x2  # linux/if_arp.h, if.h: kinds of interface, its flags, flags of /proc/net/arp
# Queueing disciplines that delay, drop or limit on purpose; the others only order what waits.
SHAPERS = ("netem", "tbf", "police", "htb", "hfsc", "cbq")
# Rules of nft and iptables that take packets away, and those of nft that overwrite bytes.
_RULE = re.compile(r"\b(drop|reject)\b|@(ll|nh|th),\d+,\d+ set ", re.IGNORECASE)


class Agent:
    """One end. Datagrams that arrive wait in the sockets' buffers, so every request is answered at once."""

    def __init__(self) -> None:
        self._sockets: dict[int, socket.socket] = {}  # by port

    def close(self) -> None:
        """Close the sockets."""
        for listener in self._sockets.values():
            listener.close()
        self._sockets.clear()

    def open(self, count: int) -> list[int]:
        """Bind `count` free ports of DDS participants; return them."""
        for port in PARTICIPANT_PORTS:
            if len(self._sockets) == count:
                break
            listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            try:
                listener.bind(("0.0.0.0", port))
            except OSError:
                listener.close()
                continue
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
            listener.setblocking(False)
            self._sockets[port] = listener
        return sorted(self._sockets)

    def count(self, word: str, size: int) -> dict[int, list[int]]:
        """Return by port: how many datagrams with this word arrived, how many of them out of order, and how many were changed.

        A changed datagram has the right size and other content, although its checksum was right or was not verified.
        """
        time.sleep(ARRIVAL_S)
        found = {}
        for port, listener in self._sockets.items():
            number, reordered, changed, highest = 0, 0, 0, -1
            with contextlib.suppress(OSError):
                while True:
                    data = listener.recv(65536)
                    if not data.startswith(RTPS_HEADER + word.encode()):
                        changed += len(data) == size and not data.startswith(RTPS_HEADER)
                        continue
                    (index,) = struct.unpack_from("!I", data, len(RTPS_HEADER) + len(word))
                    number, reordered, highest = number + 1, reordered + (index < highest), max(highest, index)
            found[port] = [number, reordered, changed]
        return found

    def send(self, address: str, ports: list[int], number: int, size: int, word: str, fragment: bool, paced: bool) -> list[Any]:
        """Send `number` datagrams of `size` bytes to each port; return how many left, and the errors of the others by name.

        With `paced` they are sent slowly, in random order: a limit of packets per second then takes none, or those of any port.
        """
        sent = 0
        errors: dict[str, int] = {}
        order = ports * number
        if paced:
            random.shuffle(order)
        with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as sender:
            sender.setsockopt(socket.IPPROTO_IP, IP_MTU_DISCOVER, IP_PMTUDISC_DONT if fragment else IP_PMTUDISC_PROBE)
            for index, port in enumerate(order):
                data = RTPS_HEADER + word.encode() + struct.pack("!I", index)
                try:
                    sender.sendto(data.ljust(size, b"\0"), (address, port))
                    sent += 1
                except OSError as error:
                    name = error.strerror or str(error)
                    errors[name] = errors.get(name, 0) + 1
                if paced:
                    time.sleep(PACE_S)
                elif (index + 1) % len(ports) == 0:
                    time.sleep(INTERVAL_S)
        return [sent, errors]

    def resolve(self, address: str, hop: str, interface: str) -> bool:
        """Wait up to RESOLVE_S until ARP has found `hop`, the next machine on the way to `address`; return whether it has.

        Until then, the kernel keeps a few packets and drops the others.
        """
        deadline = time.monotonic() + RESOLVE_S
        with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as sender:
            while not self.resolved(hop, interface):
                if time.monotonic() > deadline:
                    return False
                with contextlib.suppress(OSError):
                    sender.sendto(RTPS_HEADER, (address, DISCARD_PORT))
                time.sleep(RESOLVE_POLL_S)
        return True

    def resolved(self, hop: str, interface: str) -> bool:
        """Return whether the kernel knows the hardware address of `hop`, or needs none."""
        folder = f"/sys/class/net/{interface}/"
        if int(_read(folder + "type") or 0) != ETHERNET or int(_read(folder + "flags") or "0", 16) & NO_ARP:
            return True
        rows = [line.split() for line in _read("/proc/net/arp").splitlines()[1:]]
        return any(row[0] == hop and row[-1] == interface and int(row[2], 16) & COMPLETE for row in rows if len(row) >= 6)

    def answers(self, address: str, ports: list[int]) -> dict[int, str]:
        """Return what a datagram to each port of the other machine gives: REFUSED, SILENT, or the error of sending it.

        REFUSED: its kernel says that nothing listens there, so datagrams reach it, and its ICMP returns. UNCLEAR: no answer,
        while such answers to other datagrams came in and may have used up what the kernel sends.
        """
        before = _refusals()
        with contextlib.ExitStack() as stack:
            senders = {port: stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for port in ports}
            found: dict[int, str] = {}
            for port, sender in senders.items():
                sender.setblocking(False)
                sender.connect((address, port))
            # Linux sends one such ICMP packet a second to each computer, after a few at once, which others may have used up.
            unanswered = 0
            while len(found) < len(ports) and unanswered < 2:
                deadline, before = time.monotonic() + ICMP_WAIT_S, len(found)
                silent = [port for port in ports if port not in found]
                found.update(_outcomes(senders, silent, lambda sender: sender.send(RTPS_HEADER)))
                while len(found) < len(ports) and time.monotonic() < deadline:
                    silent = [port for port in ports if port not in found]
                    select.select([senders[port] for port in silent], [], [], max(0.0, deadline - time.monotonic()))
                    found.update(_outcomes(senders, silent, lambda sender: sender.recv(1)))
                unanswered = 0 if len(found) > before else unanswered + 1
        others = _refusals() - before - sum(answer == REFUSED for answer in found.values())
        return {port: found.get(port, UNCLEAR if others > 0 else SILENT) for port in ports}

    def knock(self, address: str, port: int) -> dict[str, int]:
        """Try to open TCP connections, and count the packets of this machine that its own kernel took.

        `unsent` could not be sent again: something here drops them before they leave. `taken` came in and were dropped before
        any socket; `taken_before` were in the third of that time before the attempt. `answered` connections were accepted or
        refused by the other machine.
        """
        before = _kernel_counters()
        time.sleep(IDLE_S)
        idle = _kernel_counters()
        with contextlib.ExitStack() as stack:
            connections = [stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_STREAM)) for _ in range(KNOCKS)]
            for connection in connections:
                connection.setblocking(False)
                connection.connect_ex((address, port))
            time.sleep(KNOCK_S)
            answered = sum(_is_answered(connection) for connection in connections)
        after = _kernel_counters()
        unsent = after.get("TcpExtTCPRetransFail", 0) - idle.get("TcpExtTCPRetransFail", 0)
        counts = {"taken": taken_packets(idle, after), "taken_before": taken_packets(before, idle)}
        return {"unsent": unsent, **counts, "answered": answered}

    def describe(self, address: str) -> dict[str, Any]:
        """Return this end of the path to `address`: interface, own address, MTU, carrier; `error` if there is no route.

        `routes` and `rules` are the lines of ip(8) that may decide: the routes that match the address, and all rules.
        """
        try:
            done = _ip("-o", "route", "get", address)
            routes = _ip("route", "show", "table", "main", "match", address).stdout.splitlines()
            rules = _ip("rule", "show").stdout.splitlines()
        except (OSError, subprocess.TimeoutExpired) as error:
            return {"error": str(error)}
        tables = {"routes": [" ".join(line.split()) for line in routes], "rules": [" ".join(line.split()) for line in rules]}
        words = done.stdout.split()
        if done.returncode or "dev" not in words:
            return {"error": done.stderr.strip() or done.stdout.strip() or "no route", **tables}
        interface = words[words.index("dev") + 1]
        return {
            "error": "",
            "interface": interface,
            "address": words[words.index("src") + 1] if "src" in words else "",
            "gateway": words[words.index("via") + 1] if "via" in words else "",
            "mtu": int(_read(f"/sys/class/net/{interface}/mtu") or 0),
            "carrier": _read(f"/sys/class/net/{interface}/carrier") == "1",
            **tables,
            "hardware": _read(f"/sys/class/net/{interface}/address"),
            "neighbor": _lines(["ip", "-4", "neigh", "show", "to", address, "dev", interface], "PERMANENT")[:1],
            "shaping": _lines(["tc", "qdisc", "show", "dev", interface], *SHAPERS),
        }

    def counters(self, interface: str, settled: bool) -> dict[str, int]:
        """Return what the kernel has counted: packets of the interface, and IPv4 packets and datagrams of the machine.

        `uptime_ns` is when. With `settled`, the last packets are in: on a busy machine, some arrive after the sender has
        finished.
        """
        found = _counters_of(interface)
        for _ in range(SETTLE_READS if settled else 0):
            time.sleep(SETTLE_S)
            before, found = found, _counters_of(interface)
            if found.get("IpInReceives", 0) - before.get("IpInReceives", 0) <= SETTLE_PACKETS:
                break
        return found

    def bound(self, first: int, last: int) -> dict[int, int]:
        """Return the UDP ports from `first` to `last` that other machines reach here, with the bytes that wait in each."""
        found: dict[int, int] = {}
        for line in _read("/proc/net/udp").splitlines()[1:]:
            words = line.split()
            address, _, port = words[1].partition(":")
            number = int(port, 16)
            if first <= number <= last and not address.endswith("7F") and number not in self._sockets:
                found[number] = max(found.get(number, 0), int(words[4].partition(":")[2], 16))
        return found

    def firewall(self) -> list[str]:
        """Return the rules of the packet filters that drop, reject or change packets, if this user may read them.

        Each begins with its place: `nft FAMILY TABLE CHAIN HOOK: `, `iptables TABLE: ` or `iptables-legacy TABLE: `. nft does
        not show the rules of the older packet filter, which the kernel applies as well; its programs show those of nft as
        theirs, unless they are called legacy.
        """
        by_nft = _place_nft(_saved_rules(["nft", "-a", "list", "ruleset"]))[:SHOWN_RULES]
        legacy = _place_iptables(_saved_rules(["iptables-legacy-save"]), "iptables-legacy")[:SHOWN_RULES]
        return by_nft + legacy or _place_iptables(_saved_rules(["iptables-save"]))[:SHOWN_RULES]


def _saved_rules(command: list[str]) -> list[str]:
    """Return the lines of a command that lists rules; none if it is missing, or this user may not read them."""
    status, lines = _output(command if os.geteuid() == 0 else ["sudo", "-n", *command])
    return lines if status == 0 else []


def _output(command: list[str]) -> tuple[int, list[str]]:
    """Return the exit status of a command and the lines that it prints; -1 and none if it cannot be run."""
    with contextlib.suppress(OSError, subprocess.TimeoutExpired):
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, timeout=3, env=_environment())
        return done.returncode, done.stdout.decode("utf-8", "replace").splitlines()
    return -1, []


def _environment() -> dict[str, str]:
    return dict(os.environ, LC_ALL="C", PATH=os.environ.get("PATH", "") + ":/usr/sbin:/sbin")


def _ip(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["ip", "-4", *words], capture_output=True, text=True, timeout=3, env=_environment())


def _place_nft(lines: list[str]) -> list[str]:
    found = []
    table = chain = hook = "-"
    for line in lines:
        words = line.split()
        if words[:1] == ["table"]:
            table = " ".join(words[1:3])
        elif words[:1] == ["chain"]:
            chain, hook = words[1], "-"
        elif words[:1] == ["type"] and "hook" in words:
            hook = words[words.index("hook") + 1]
        if _RULE.search(line) and words[:1] != ["table"]:
            found.append(f"nft {table} {chain} {hook}: {line.strip()}")
    return found


def _place_iptables(lines: list[str], tool: str = "iptables") -> list[str]:
    found = []
    table = "-"
    for line in lines:
        if line.startswith("*"):
            table = line[1:].strip()
        elif _RULE.search(line):
            found.append(f"{tool} {table}: {line.strip()}")
    return found


def _lines(command: list[str], *words: str) -> list[str]:
    """Return the output lines of a command that contain one of the words; none if it cannot be run."""
    return [" ".join(line.split()) for line in _output(command)[1] if any(word in line for word in words)]


def _outcomes(senders: dict[int, socket.socket], ports: list[int], call: Callable[[socket.socket], object]) -> dict[int, str]:
    """Return what is known of each port after a call on its socket, by the error that it raised or by the answer."""
    found = {}
    for port in ports:
        try:
            if isinstance(call(senders[port]), bytes):
                found[port] = ANSWERED
        except BlockingIOError:
            continue
        except ConnectionRefusedError:
            found[port] = REFUSED
        except OSError as error:
            found[port] = error.strerror or str(error)
    return found


def _read(path: str) -> str:
    with contextlib.suppress(OSError):
        return Path(path).read_text().strip()
    return ""


def taken_packets(before: Mapping[str, int], after: Mapping[str, int]) -> int:
    """Return how many IPv4 packets came in between two readings and became no datagram of a socket and were not refused.

    Fragments count once each, and those that were forwarded or have a damaged header not at all.
    """
    into = {name: count - before.get(name, 0) for name, count in after.items()}
    waiting_fragments = into.get("IpReasmReqds", 0) - into.get("IpReasmOKs", 0)
    passed = into.get("IpInDelivers", 0) + into.get("IpForwDatagrams", 0) + into.get("IpInHdrErrors", 0)
    return max(into.get("IpInReceives", 0) - passed - max(waiting_fragments, 0), 0)


def _counters_of(interface: str) -> dict[str, int]:
    folder = f"/sys/class/net/{interface}/statistics/"
    found = {name: int(_read(folder + name) or 0) for name in ("rx_packets", "tx_packets", "rx_dropped", "rx_errors")}
    return {"uptime_ns": time.monotonic_ns(), **found, **_kernel_counters()}


def _is_answered(connection: socket.socket) -> bool:
    """Return whether a connection that was begun has been accepted, or refused by the other machine."""
    error = connection.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
    if error:
        return error == errno.ECONNREFUSED
    with contextlib.suppress(OSError):
        return bool(connection.getpeername())
    return False


def _refusals() -> int:
    """Return how many ICMP messages "destination unreachable" this machine has received."""
    return _proc_table("/proc/net/snmp", "Icmp").get("IcmpInDestUnreachs", 0)


def _kernel_counters() -> dict[str, int]:
    found: dict[str, int] = {}
    for file, table in (("snmp", "Ip"), ("snmp", "Udp"), ("netstat", "TcpExt")):
        found.update(_proc_table("/proc/net/" + file, table))
    return found


def _proc_table(path: str, table: str) -> dict[str, int]:
    names: list[str] = []
    values: list[str] = []
    for line in _read(path).splitlines():
        head, _, rest = line.partition(":")
        if head == table:
            names, values = (names, rest.split()) if names else (rest.split(), values)
    return {table + name: int(value) for name, value in zip(names, values)}


def serve(read: Callable[[], str], write: Callable[[str], object]) -> None:
    """Answer requests until the input ends."""
    agent = Agent()
    for line in iter(read, ""):
        request = json.loads(line)
        write(json.dumps(getattr(agent, request.pop("do"))(**request)) + "\n")


if __name__ == "__main__":

    def _write(text: str) -> None:
        sys.stdout.write(text)
        sys.stdout.flush()

    # Nobody may be left to ask: the agent ends if its input stays silent.
    def _readline() -> str:
        return sys.stdin.readline() if select.select([sys.stdin], [], [], 60.0)[0] else ""

    serve(_readline, _write)
