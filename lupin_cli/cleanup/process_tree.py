"""The process tree of a machine, and which processes map which file of /dev/shm."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, integer, parse_sections

# `[ -r FILE ]` does not show whether the maps can be read: their mode is 0444, and open() fails. A process that has exited
# meanwhile maps nothing. The command is `true`, because dash exits if a redirection of the special builtin `:` fails.
PROBE = (
    PRELUDE
    + r"""echo '@@ stat'; cat /proc/[0-9]*/stat 2>/dev/null
echo '@@ maps'; grep -HosE '/dev/shm/[^ ]+' /proc/[0-9]*/maps | sort -u
echo '@@ unreadable'
for maps in /proc/[0-9]*/maps; do { true <"$maps"; } 2>/dev/null || [ ! -e "$maps" ] || echo "$maps"; done
echo '@@ end'
exit 0
"""
)


# proc(5): ppid and starttime are fields 4 and 22 of /proc/PID/stat, counted from 1; field 3 follows the name in parentheses.
_PARENT, _START = 4 - 3, 22 - 3


@dataclass(frozen=True)
class ProcessNode:
    """A process in the tree. Its start, in clock ticks since boot, distinguishes it from a later process with the same PID."""

    pid: int
    parent: int
    start_ticks: int
    name: str  # cut to 15 characters by the kernel


@dataclass(frozen=True)
class ProcessTree:
    """All processes by PID, and the PIDs that map each file of /dev/shm."""

    processes: Mapping[int, ProcessNode]
    mapped_by: Mapping[str, tuple[int, ...]] = field(default_factory=dict)  # PIDs by file name
    all_maps_readable: bool = True  # False if the memory maps of other users' processes could not be read

    def ancestors(self, pid: int) -> Iterator[ProcessNode]:
        """Parent, grandparent and so on, up to the first process."""
        seen = {pid}
        while (process := self.processes.get(pid)) is not None and process.parent not in seen:
            seen.add(pid := process.parent)
            if pid in self.processes:
                yield self.processes[pid]


def parse(output: Output) -> ProcessTree:
    """Pure parser of PROBE. Raises ValueError."""
    sections = parse_sections(output)
    if sections.get("end") is None:
        raise ValueError("the probe ended before its last line")
    processes = {}
    begun = ""
    for line in sections.lines("stat"):
        # The name may contain anything, also line breaks; the fields after the last parenthesis may not (proc(5)).
        head, _, rest = (begun + line).rpartition(")")
        pid, _, name = head.partition(" (")
        fields = rest.split()
        if len(fields) <= _START:
            begun += line + "\n"
            continue
        number, parent = integer(pid, "a PID"), integer(fields[_PARENT], "a parent PID")
        processes[number] = ProcessNode(number, parent, integer(fields[_START], "a start time"), name)
        begun = ""
    if begun:
        raise ValueError(f"expected a line of /proc/PID/stat, found {begun[:80]!r}")
    mapped_by: dict[str, list[int]] = {}
    for line in sections.lines("maps"):
        found = re.match(r"/proc/(\d+)/maps:/dev/shm/(.+)", line)
        if found:
            mapped_by.setdefault(found[2], []).append(int(found[1]))
    return ProcessTree(processes, {name: tuple(pids) for name, pids in mapped_by.items()}, not sections.lines("unreadable"))


PROCESS_TREE = Fact("process-tree", PROBE, parse, timeout_s=4.0)
