"""DDS packets that a machine sends and receives, counted for a few seconds.

The probe is slow and needs root, so checks use it only to follow up a link that passes data in one direction. It reads only the
addresses and ports of packets, and stores none of them. Loopback and other traffic are ignored.
"""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, integer, parse_sections
from lupin_runtime.ports import DISCOVERY_PORT

CAPTURE_S = 6.0  # the graph probe, which causes the packets, joins within two seconds and calls services for three
MAX_PACKETS = 20_000
# RTPS 2.2, 9.6.1.1: the ports of domain d start at 7400 + 250 d. From the tenth on, even offsets are for discovery and odd ones
# for data, two ports per participant; 80 ports are enough for the participants of this project.
FIRST_PORT, _PORTS_PER_DOMAIN, _FIRST_UNICAST, _UNICAST_PORTS = 7400, 250, 10, 80
LAST_PORT = FIRST_PORT + _PORTS_PER_DOMAIN * 101 + _UNICAST_PORTS

# A packet socket, since few robots have tcpdump. Only ETH_P_ALL (3) delivers outgoing packets, too.
_COUNTER = f"""
import collections, socket, struct, time
raw = socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(3))
raw.settimeout(0.2)
seen, remaining, end = collections.Counter(), {MAX_PACKETS}, time.monotonic() + {CAPTURE_S}
while remaining and time.monotonic() < end:
    try:
        data, sender = raw.recvfrom(64)
    except OSError:
        continue
    if sender[1] != 0x0800 or sender[0] == "lo" or len(data) < 28 or data[9] != 17:
        continue
    header = (data[0] & 15) * 4
    if struct.unpack_from("!H", data, 6)[0] & 0x1FFF or len(data) < header + 4:
        continue
    port = struct.unpack_from("!H", data, header + 2)[0]
    if port == {DISCOVERY_PORT} or {FIRST_PORT} <= port <= {LAST_PORT}:
        seen[socket.inet_ntoa(data[12:16]), socket.inet_ntoa(data[16:20]), port] += 1
        remaining -= 1
print("@@ flows")
for (source, destination, port), count in seen.items():
    print(source, destination, port, count)
"""
_FILTER = f"udp and not net 127.0.0.0/8 and (port {DISCOVERY_PORT} or dst portrange {FIRST_PORT}-{LAST_PORT})"
PROBE = (
    PRELUDE
    + f"""as=; [ "$(id -u)" = 0 ] || {{ command -v sudo >/dev/null && sudo -n true 2>/dev/null && as='sudo -n' || as=nobody; }}
echo '@@ own'; ip -4 -o address show scope global | awk '{{ split($4, part, "/"); print part[1] }}'
if [ "$as" = nobody ]; then echo '@@ refused'; echo "$(id -un) may not capture packets: needs root, or sudo without password"
elif command -v python3 >/dev/null 2>&1; then
  counts=$($as timeout {CAPTURE_S + 2:.0f} python3 -I -c {shlex.quote(_COUNTER)} 2>&1) && printf '%s\\n' "$counts" ||
    {{ echo '@@ refused'; printf '%s\\n' "$counts" | tail -n 1; }}
elif command -v tcpdump >/dev/null 2>&1; then
  echo '@@ tcpdump'
  $as timeout {CAPTURE_S:.0f} tcpdump -nn -q -t -l -i any -c {MAX_PACKETS} {shlex.quote(_FILTER)} 2>/dev/null || true
else echo '@@ refused'; echo 'the machine has neither python3 nor tcpdump'; fi
echo '@@ end'
"""
)
_TCPDUMP = re.compile(r"\bIP (\d+\.\d+\.\d+\.\d+)\.\d+ > (\d+\.\d+\.\d+\.\d+)\.(\d+): ")


@dataclass(frozen=True)
class Flow:
    """Packets from one address to another address and port."""

    source: str
    destination: str
    port: int
    count: int

    @property
    def is_data(self) -> bool:
        """Whether the port is for data: samples, requests and answers. Discovery uses other ports."""
        offset = (self.port - FIRST_PORT) % _PORTS_PER_DOMAIN - _FIRST_UNICAST
        return FIRST_PORT <= self.port <= LAST_PORT and 0 <= offset < _UNICAST_PORTS and offset % 2 == 1


@dataclass(frozen=True)
class Packets:
    """The packet counts, or the reason why packets could not be captured."""

    own: tuple[str, ...]  # the machine's addresses
    flows: tuple[Flow, ...] = ()
    refused: str = ""

    def sent_flows(self) -> tuple[Flow, ...]:
        """Return the flows to other machines."""
        return tuple(flow for flow in self.flows if flow.source in self.own and flow.destination not in self.own)

    def received_flows(self) -> tuple[Flow, ...]:
        """Return the flows from other machines to one of this machine's addresses."""
        return tuple(flow for flow in self.flows if flow.destination in self.own and flow.source not in self.own)


def parse(output: Output) -> Packets:
    """Parse the output of PROBE. Raises ValueError."""
    sections = parse_sections(output)
    sections.lines("end")
    own = tuple(line.strip() for line in sections.lines("own"))
    if refused := sections.get("refused"):
        return Packets(own, refused=refused.text or "no reason was given")
    if dumped := sections.get("tcpdump"):
        counts: dict[tuple[str, str, int], int] = {}
        for source, destination, port in _TCPDUMP.findall("\n".join(dumped.lines)):
            key = (source, destination, int(port))
            counts[key] = counts.get(key, 0) + 1
        return Packets(own, tuple(Flow(*key, count) for key, count in counts.items()))
    flows = []
    for line in sections.lines("flows"):
        words = line.split()
        if len(words) != 4:
            raise ValueError(f"expected source, destination, port and count, found {line[:80]!r}")
        flows.append(Flow(words[0], words[1], integer(words[2], "a port"), integer(words[3], "a count")))
    return Packets(own, tuple(flows))


PACKETS = Fact("packets", PROBE, parse, timeout_s=CAPTURE_S + 6.0)
