"""Whether the kernel of a machine takes its wall clock for synchronized, whichever program set it."""

from __future__ import annotations

from dataclasses import dataclass

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, parse_sections

# systemd-timedated answers from adjtimex(2). The flag ends with any step by hand, and some nine hours after the last source.
PROBE = PRELUDE + "echo '@@ synchronized'; timeout 3 timedatectl show --property=NTPSynchronized --value 2>/dev/null\n"


@dataclass(frozen=True)
class KernelClock:
    """`is_synchronized` is None if the machine has no systemd-timedated that answers."""

    is_synchronized: bool | None


def parse(output: Output) -> KernelClock:
    """Parse the output of PROBE. Raises ValueError."""
    return KernelClock({"yes": True, "no": False}.get(parse_sections(output).text("synchronized")))


KERNEL_CLOCK = Fact("kernel-clock", PROBE, parse)
