"""Who started whom, and what maps which file of /dev/shm."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import field

from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, answers, integer
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Output

PROBE = (
    PRELUDE
    + r"""echo '@@ stat'; cat /proc/[0-9]*/stat 2>/dev/null
echo '@@ maps'; grep -HosE '/dev/shm/[^ ]+' /proc/[0-9]*/maps | sort -u
echo '@@ unreadable'; for maps in /proc/[0-9]*/maps; do [ -r "$maps" ] || echo "$maps"; done
echo '@@ end'
exit 0
"""
)


@dataclass(frozen=True)
class Member:
    """A process among its relatives. Its start, in clock ticks since boot, tells it from a later one with the same number."""

    pid: int
    parent: int
    start_ticks: int
    name: str  # cut to 15 characters by the kernel


@dataclass(frozen=True)
class Families:
    """All processes, and the files of /dev/shm that each has mapped."""

    members: Mapping[int, Member]
    maps: Mapping[str, tuple[int, ...]] = field(default_factory=dict)  # file name: processes
    every_map_read: bool = True  # False where other users' processes could not be looked at

    def ancestors(self, pid: int) -> Iterator[Member]:
        """Parent, grandparent and so on, up to the first process."""
        seen = {pid}
        while (member := self.members.get(pid)) is not None and member.parent not in seen:
            seen.add(pid := member.parent)
            if pid in self.members:
                yield self.members[pid]


def parse(output: Output) -> Families:
    """Pure parser of PROBE. Raises ValueError."""
    said = answers(output)
    if said.maybe("end") is None:
        raise ValueError("the probe ended before its last line")
    members = {}
    for line in said.lines("stat"):
        # The name may hold spaces and parentheses; what follows the last one may not (proc(5)).
        head, _, rest = line.rpartition(")")
        pid, _, name = head.partition(" (")
        words = rest.split()
        if len(words) < 20:
            raise ValueError(f"expected a line of /proc/PID/stat, found {line[:80]!r}")
        number = integer(pid, "a process")
        members[number] = Member(number, integer(words[1], "a parent"), integer(words[19], "a start time"), name)
    maps: dict[str, list[int]] = {}
    for line in said.lines("maps"):
        found = re.match(r"/proc/(\d+)/maps:/dev/shm/(.+)", line)
        if found:
            maps.setdefault(found[2], []).append(int(found[1]))
    return Families(members, {name: tuple(pids) for name, pids in maps.items()}, not said.lines("unreadable"))


FAMILIES = Fact("process-families", PROBE, parse, timeout_s=4.0)
