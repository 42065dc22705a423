"""chrony: installed, running, serving, disciplined by whom, and what its configuration says of steps."""

from __future__ import annotations

import re

from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, Answers, answers
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Output

NTP_PORT = 123
# Local address and port of `ss`: 0.0.0.0:123, [::]:123, *:123.
_LISTENS = re.compile(rf":{NTP_PORT}\s")
DIRECTIVES = "makestep|allow|deny|local|server|pool|peer|confdir|sourcedir|include|port|rtcsync"

# chronyc waits for a daemon that isn't there up to seven seconds, so its own words are asked for only where one runs.
PROBE = (
    PRELUDE
    + f"""running=$(pidof -s chronyd)
echo '@@ chronyd'; command -v chronyd
echo '@@ running'; echo "$running"
echo '@@ files'
grep -HnsE '^[[:space:]]*({DIRECTIVES})' \
  /etc/chrony/chrony.conf /etc/chrony.conf /etc/chrony/conf.d/*.conf /etc/chrony/sources.d/*.sources
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
class Source:
    """One source of time as `chronyc -c sources` prints it."""

    address: str
    state: str  # * selected, + combined, - not combined, ? unusable, x falseticker, ~ too variable
    stratum: int
    reach: int  # octal as chrony prints it, read as a number: 377 is the last eight polls answered
    offset_s: float
    raw: str


@dataclass(frozen=True)
class Tracking:
    """What the clock is disciplined by, as `chronyc -c tracking` prints it."""

    reference: str
    stratum: int
    offset_s: float
    leap: str
    raw: str

    @property
    def synchronised(self) -> bool:
        """Whether chrony holds the clock to anything."""
        return self.leap != "Not synchronised" and self.stratum > 0


@dataclass(frozen=True)
class Chrony:
    """chrony on one machine. `conf` holds the lines that matter as `file:number:text`."""

    installed: bool
    running: bool
    conf: tuple[str, ...]
    listeners: tuple[str, ...]  # UDP listeners on the NTP port, as ss prints them
    tracking: Tracking | None
    sources: tuple[Source, ...]
    others: tuple[str, ...] = ()  # other programs that discipline the clock

    def directives(self, name: str) -> tuple[str, ...]:
        """The configuration lines of one directive."""
        return tuple(line for line in self.conf if _text(line).split()[:1] == [name])

    @property
    def serves(self) -> bool:
        """Whether anybody else can ask it: chrony opens port 123 only where `allow` lets somebody in."""
        return self.running and bool(self.listeners)


def parse(output: Output) -> Chrony:
    """Pure parser of PROBE. Raises ValueError."""
    said = answers(output)
    said.lines("end")
    return Chrony(
        installed=bool(said.lines("chronyd")),
        running=bool(said.lines("running")),
        conf=said.lines("files"),
        listeners=tuple(line for line in said.lines("listeners") if _LISTENS.search(line)),
        tracking=_tracking(said),
        sources=_sources(said),
        others=said.lines("other"),
    )


def _tracking(said: Answers) -> Tracking | None:
    raw = next(iter(said.lines("tracking")), "") if said.maybe("tracking") else ""
    fields = raw.split(",")
    if len(fields) < 14:  # e.g. `506 Cannot talk to daemon`
        return None
    return Tracking(fields[1], int(fields[2] or 0), float(fields[4]), fields[13], raw)


def _sources(said: Answers) -> tuple[Source, ...]:
    lines = said.lines("sources") if said.maybe("sources") else ()
    rows = [(line, line.split(",")) for line in lines]
    return tuple(
        Source(fields[2], fields[1], int(fields[3]), int(fields[5]), float(fields[7]), line)
        for line, fields in rows
        if len(fields) >= 10 and fields[0] in ("^", "=", "#")
    )


def _text(line: str) -> str:
    """The directive of a `file:number:text` line."""
    return line.split(":", 2)[-1].strip()


CHRONY = Fact("chrony", PROBE, parse)
