"""Which boot this is, how long ago it began, and how busy the machine is."""

from __future__ import annotations

from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, answers, integer, number
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Output

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
    load: tuple[float, float, float]  # of the last 1, 5 and 15 minutes: processes that run or wait for a disk
    cores: int
    kernel: str
    hostname: str
    load_line: str


def parse(output: Output) -> Boot:
    """Pure parser of PROBE. Raises ValueError."""
    said = answers(output)
    line = said.text("loadavg")
    load = [number(word, "a load average") for word in line.split()[:3]]
    if len(load) != 3:
        raise ValueError(f"expected three load averages, found {line!r}")
    cores = integer(said.text("cores"), "the number of cores")
    if cores < 1:
        raise ValueError(f"expected at least one core, found {cores}")
    return Boot(
        boot_id=said.text("boot-id"),
        uptime_s=said.number("uptime"),
        load=(load[0], load[1], load[2]),
        cores=cores,
        kernel=said.text("kernel"),
        hostname=said.text("hostname"),
        load_line=line,
    )


BOOT = Fact("boot", PROBE, parse)
