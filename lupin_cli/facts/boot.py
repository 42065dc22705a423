"""The current boot: its ID, uptime, load, kernel and host name."""

from __future__ import annotations

from dataclasses import dataclass

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, integer, number, parse_sections

PROBE = (
    PRELUDE
    + """echo '@@ boot-id'; cat /proc/sys/kernel/random/boot_id
echo '@@ uptime'; cat /proc/uptime
echo '@@ loadavg'; cat /proc/loadavg
echo '@@ cores'; getconf _NPROCESSORS_ONLN
echo '@@ kernel'; uname -srm
echo '@@ hostname'; uname -n
"""
)


@dataclass(frozen=True)
class Boot:
    """One boot of a machine."""

    boot_id: str
    uptime_s: float
    load: tuple[float, float, float]  # over 1, 5 and 15 minutes: processes that run or wait for a disk
    cores: int
    kernel: str
    hostname: str
    load_line: str


def parse(output: Output) -> Boot:
    """Parse the output of PROBE. Raises ValueError."""
    sections = parse_sections(output)
    line = sections.text("loadavg")
    load = [number(word, "a load average") for word in line.split()[:3]]
    if len(load) != 3:
        raise ValueError(f"expected three load averages, found {line!r}")
    cores = integer(sections.text("cores"), "the number of cores")
    if cores < 1:
        raise ValueError(f"expected at least one core, found {cores}")
    return Boot(
        boot_id=sections.text("boot-id"),
        uptime_s=sections.number("uptime"),
        load=(load[0], load[1], load[2]),
        cores=cores,
        kernel=sections.text("kernel"),
        hostname=sections.text("hostname"),
        load_line=line,
    )


BOOT = Fact("boot", PROBE, parse)
