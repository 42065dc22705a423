"""chrony: whether it is installed, running and serving, its sources, and the relevant lines of its configuration."""

from __future__ import annotations

import re
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Network

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.chrony_configuration import READER, parse_line
from lupin_cli.facts.sections import PRELUDE, Sections, parse_sections

NTP_PORT = 123
# Local address and port as ss(8) prints them: 0.0.0.0:123, [::]:123, *:123.
_NTP_LISTENER = re.compile(rf":{NTP_PORT}\s")
DIRECTIVES = "makestep|allow|deny|local|server|pool|peer|confdir|sourcedir|include|port|rtcsync"

# Without a daemon, chronyc blocks for up to seven seconds, so it is only called if chronyd runs.
PROBE = (
    PRELUDE
    + READER
    + f"""running=$(pidof -s chronyd)
echo '@@ chronyd'; command -v chronyd
echo '@@ running'; echo "$running"
echo '@@ files'; chrony_lines '{DIRECTIVES}'
echo '@@ listeners'; ss -H -lnu 'sport = :{NTP_PORT}' 2>/dev/null
if [ -n "$running" ]; then
  echo '@@ tracking'; timeout 2 chronyc -c -n tracking 2>&1
  echo '@@ sources'; timeout 2 chronyc -c -n sources 2>&1
fi
echo '@@ other'; for p in ntpd systemd-timesyncd; do pidof -s "$p" >/dev/null 2>&1 && echo "$p"; done
echo '@@ end'
"""
)


@dataclass(frozen=True)
class TimeSource:
    """A time source: one line of `chronyc -c sources`."""

    address: str
    state: str  # * selected, + combined, - not combined, ? unusable, x falseticker, ~ too variable
    stratum: int
    reach: int  # bit mask of the last eight polls, in octal digits: 377 means that all were answered
    offset_s: float
    raw: str


@dataclass(frozen=True)
class Tracking:
    """The reference of the clock, from `chronyc -c tracking`."""

    reference: str
    stratum: int
    offset_s: float
    leap: str
    raw: str

    @property
    def synchronized(self) -> bool:
        """Whether chrony is synchronized to a reference."""
        return self.leap != "Not synchronised" and self.stratum > 0


@dataclass(frozen=True)
class Chrony:
    """chrony on one machine. `conf` has the relevant lines of its configuration as `file:number:text`."""

    installed: bool
    running: bool
    conf: tuple[str, ...]
    listeners: tuple[str, ...]  # UDP listeners on the NTP port, as ss prints them
    tracking: Tracking | None
    sources: tuple[TimeSource, ...]
    others: tuple[str, ...] = ()  # other programs that discipline the clock

    def directives(self, name: str) -> tuple[str, ...]:
        """Return the configuration lines of one directive."""
        return tuple(line for line in self.conf if parse_line(line)[1][:1] == [name])

    @property
    def steps(self) -> tuple[str, ...]:
        """The lines by which chrony may step the clock at any time: its `makestep`, of which the last one counts."""
        lines = self.directives("makestep")
        words = parse_line(lines[-1])[1] if lines else []
        return () if len(words) == 3 and words[2] == "0" else lines  # a limit of no updates forbids it

    def allows(self, address: str) -> bool:
        """Return whether its configuration lets this IPv4 address ask for the time: the most specific directive decides."""
        asking = IPv4Address(address)
        deciding: tuple[int, bool] = (-1, False)
        for line in (*self.directives("allow"), *self.directives("deny")):
            words = [word.lower() for word in parse_line(line)[1]]
            network = _network(next((word for word in words[1:] if word != "all"), "0.0.0.0/0"))
            if network is not None and asking in network and network.prefixlen >= deciding[0]:
                deciding = network.prefixlen, words[0] == "allow"
        return deciding[1]

    @property
    def serves(self) -> bool:
        """Whether it serves time to other machines: chrony opens port 123 only if an `allow` directive admits one."""
        return self.running and bool(self.listeners)


def parse(output: Output) -> Chrony:
    """Parse the output of PROBE. Raises ValueError."""
    sections = parse_sections(output)
    sections.lines("end")
    return Chrony(
        installed=bool(sections.lines("chronyd")),
        running=bool(sections.lines("running")),
        conf=sections.lines("files"),
        listeners=tuple(line for line in sections.lines("listeners") if _NTP_LISTENER.search(line)),
        tracking=_tracking(sections),
        sources=_sources(sections),
        others=sections.lines("other"),
    )


def _tracking(sections: Sections) -> Tracking | None:
    raw = next(iter(sections.lines("tracking")), "") if sections.get("tracking") else ""
    fields = raw.split(",")
    if len(fields) < 14:  # e.g. `506 Cannot talk to daemon`
        return None
    return Tracking(fields[1], int(fields[2] or 0), float(fields[4]), fields[13], raw)


def _sources(sections: Sections) -> tuple[TimeSource, ...]:
    lines = sections.lines("sources") if sections.get("sources") else ()
    rows = [(line, line.split(",")) for line in lines]
    return tuple(
        TimeSource(fields[2], fields[1], int(fields[3]), int(fields[5]), float(fields[7]), line)
        for line, fields in rows
        if len(fields) >= 10 and fields[0] in ("^", "=", "#")
    )


def _network(text: str) -> IPv4Network | None:
    """Return the network of an `allow` or `deny` directive, which may leave out zeros at the end; None for IPv6 and names."""
    address, slash, length = text.partition("/")
    octets = address.split(".")
    if not all(octet.isdigit() for octet in octets) or len(octets) > 4:
        return None
    whole = ".".join((octets + ["0"] * 3)[:4])
    try:
        return IPv4Network(f"{whole}/{length if slash else 8 * len(octets)}", strict=False)
    except ValueError:
        return None


CHRONY = Fact("chrony", PROBE, parse)
