"""DDS packets that come and go at a machine, counted for a few seconds: what really left, and what really arrived.

Dear, and only root may: no check asks for it but for a closer look at a way that is open in one direction only. Packets are
counted and not kept, and nothing but their addresses and ports is read. Loopback and other traffic are left out.
"""

from __future__ import annotations

import re
import shlex

from lupin_cli.facts.base import Fact
from lupin_cli.facts.dds_profiles import DISCOVERY_PORT
from lupin_cli.facts.sections import PRELUDE, answers, integer
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Output

CAPTURE_S = 6.0  # a visit to the graph, which makes the packets, takes a second or two to join, and calls for three
MOST_PACKETS = 20_000
# RTPS 2.2, 9.6.1.1: domain d has 7400 + 250 d and the ports after it; there, from 10 on, even ones are for discovery and odd
# ones for data. Beyond the 40th port no participant of this project comes.
FIRST_PORT, _PER_DOMAIN, _UNICAST, _USED = 7400, 250, 10, 80
LAST_PORT = FIRST_PORT + _PER_DOMAIN * 101 + _USED

# A raw socket of the kernel's own, since few robots have tcpdump. ETH_P_ALL: packets that leave are shown to nobody else.
_COUNT = f"""
import collections, socket, struct, time
raw = socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(3))
raw.settimeout(0.2)
seen, left, end = collections.Counter(), {MOST_PACKETS}, time.monotonic() + {CAPTURE_S}
while left and time.monotonic() < end:
    try:
        data, where = raw.recvfrom(64)
    except OSError:
        continue
    if where[1] != 0x0800 or where[0] == "lo" or len(data) < 28 or data[9] != 17:
        continue
    head = (data[0] & 15) * 4
    if struct.unpack_from("!H", data, 6)[0] & 0x1FFF or len(data) < head + 4:
        continue
    port = struct.unpack_from("!H", data, head + 2)[0]
    if port == {DISCOVERY_PORT} or {FIRST_PORT} <= port <= {LAST_PORT}:
        seen[socket.inet_ntoa(data[12:16]), socket.inet_ntoa(data[16:20]), port] += 1
        left -= 1
print("@@ flows")
for (source, destination, port), count in seen.items():
    print(source, destination, port, count)
"""
_FILTER = f"udp and not net 127.0.0.0/8 and (port {DISCOVERY_PORT} or dst portrange {FIRST_PORT}-{LAST_PORT})"
PROBE = (
    PRELUDE
    + f"""as=; [ "$(id -u)" = 0 ] || {{ command -v sudo >/dev/null && sudo -n true 2>/dev/null && as='sudo -n' || as=nobody; }}
echo '@@ own'; ip -4 -o address show scope global | awk '{{ split($4, part, "/"); print part[1] }}'
if [ "$as" = nobody ]; then echo '@@ refused'; echo "$(id -un) may not capture: that takes root, or sudo without a password"
elif command -v python3 >/dev/null 2>&1; then
  said=$($as timeout {CAPTURE_S + 2:.0f} python3 -c {shlex.quote(_COUNT)} 2>&1) && printf '%s\\n' "$said" ||
    {{ echo '@@ refused'; printf '%s\\n' "$said" | tail -n 1; }}
elif command -v tcpdump >/dev/null 2>&1; then
  echo '@@ tcpdump'
  $as timeout {CAPTURE_S:.0f} tcpdump -nn -q -t -l -i any -c {MOST_PACKETS} {shlex.quote(_FILTER)} 2>/dev/null || true
else echo '@@ refused'; echo 'there is neither python3 nor tcpdump'; fi
echo '@@ end'
"""
)
_TCPDUMP = re.compile(r"\bIP (\d+\.\d+\.\d+\.\d+)\.\d+ > (\d+\.\d+\.\d+\.\d+)\.(\d+): ")


@dataclass(frozen=True)
class Flow:
    """Packets of one sender to one address and port."""

    source: str
    destination: str
    port: int
    count: int

    @property
    def is_data(self) -> bool:
        """Whether the port is one that samples, requests and answers go to; discovery goes to others."""
        above = (self.port - FIRST_PORT) % _PER_DOMAIN - _UNICAST
        return FIRST_PORT <= self.port <= LAST_PORT and 0 <= above < _USED and above % 2 == 1


@dataclass(frozen=True)
class Packets:
    """What was counted, or why nothing was."""

    own: tuple[str, ...]  # addresses of the machine
    flows: tuple[Flow, ...] = ()
    refused: str = ""

    def sent(self) -> tuple[Flow, ...]:
        """What left for other machines."""
        return tuple(flow for flow in self.flows if flow.source in self.own and flow.destination not in self.own)

    def arrived(self) -> tuple[Flow, ...]:
        """What came in for one of its addresses."""
        return tuple(flow for flow in self.flows if flow.destination in self.own and flow.source not in self.own)


def parse(output: Output) -> Packets:
    """Pure parser of PROBE. Raises ValueError."""
    said = answers(output)
    said.lines("end")
    own = tuple(line.strip() for line in said.lines("own"))
    if refused := said.maybe("refused"):
        return Packets(own, refused=refused.text or "it was not said why")
    if dumped := said.maybe("tcpdump"):
        counts: dict[tuple[str, str, int], int] = {}
        for source, destination, port in _TCPDUMP.findall("\n".join(dumped.lines)):
            key = (source, destination, int(port))
            counts[key] = counts.get(key, 0) + 1
        return Packets(own, tuple(Flow(*key, count) for key, count in counts.items()))
    flows = []
    for line in said.lines("flows"):
        words = line.split()
        if len(words) != 4:
            raise ValueError(f"expected source, destination, port and count, found {line[:80]!r}")
        flows.append(Flow(words[0], words[1], integer(words[2], "a port"), integer(words[3], "a count")))
    return Packets(own, tuple(flows))


PACKETS = Fact("packets", PROBE, parse, timeout_s=CAPTURE_S + 6.0)
