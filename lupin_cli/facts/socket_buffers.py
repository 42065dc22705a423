"""The largest socket buffers that programs may have, and how many datagrams full buffers have cost within a moment."""

from __future__ import annotations

from dataclasses import dataclass

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, Sections, integer, parse_sections

WINDOW_S = 0.3
PROBE = (
    PRELUDE
    + f"""for each in rmem_max wmem_max; do echo "@@ $each"; cat /proc/sys/net/core/$each 2>/dev/null; done
echo '@@ before'; grep '^Udp:' /proc/net/snmp
sleep {WINDOW_S}
echo '@@ after'; grep '^Udp:' /proc/net/snmp
"""
)


@dataclass(frozen=True)
class SocketBuffers:
    """One machine's limits, in bytes (None where the kernel shows none), and the datagrams lost within WINDOW_S."""

    receive_limit: int | None
    send_limit: int | None
    lost_receiving: int
    lost_sending: int


def parse(output: Output) -> SocketBuffers:
    """Parse the output of PROBE. Raises ValueError."""
    sections = parse_sections(output)
    before, after = _udp_counters(sections, "before"), _udp_counters(sections, "after")
    return SocketBuffers(
        _limit(sections, "rmem_max"),
        _limit(sections, "wmem_max"),
        after.get("RcvbufErrors", 0) - before.get("RcvbufErrors", 0),
        after.get("SndbufErrors", 0) - before.get("SndbufErrors", 0),
    )


def _limit(sections: Sections, name: str) -> int | None:
    lines = sections.lines(name)
    return integer(lines[0], "a limit in bytes") if lines else None


def _udp_counters(sections: Sections, name: str) -> dict[str, int]:
    lines = [line.split() for line in sections.lines(name)]
    if len(lines) != 2 or len(lines[0]) != len(lines[1]):
        raise ValueError(f"expected two lines of /proc/net/snmp, found {sections.lines(name)!r:.80}")
    return {key: integer(value, "a counter") for key, value in zip(lines[0][1:], lines[1][1:])}


SOCKET_BUFFERS = Fact("socket-buffers", PROBE, parse)
