"""Fast DDS's files in /dev/shm, and whether a live process holds them.

Fast DDS locks `<segment>_el` and `<port>_el` with flock(2) for as long as their owner lives (measured with 2.14: WRITE locks in
/proc/locks). A file whose lock nobody holds is an orphan, however young; one that is held is in use, however old.
"""

from __future__ import annotations

import os
import re

from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, answers, integer
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Output

# Locks of processes in other PID namespaces (containers) are not in /proc/locks, but flock(1) runs into them. It opens without
# creating and tries without waiting; whoever meets the probe in that instant sees a file in use and leaves it alone.
PROBE = (
    PRELUDE
    + r"""cd /dev/shm 2>/dev/null || { echo '@@ files'; echo '@@ end'; exit 0; }
echo '@@ files'
for file in fastrtps_* fastdds_* sem.fastrtps_* sem.fastdds_*; do [ -e "$file" ] && printf '%s\n' "$file"; done |
  xargs -r stat -c '%i %u %s %Z %n' 2>/dev/null
echo '@@ device'; stat -c %D . 2>/dev/null
echo '@@ locks'; cat /proc/locks 2>/dev/null
echo '@@ tried'
for file in fastrtps_*_el fastrtps_*_sl fastdds_*_el fastdds_*_sl; do
  [ -e "$file" ] || continue
  if ( flock -n -x 9 ) 9<"$file" 2>/dev/null; then echo "free $file"; else echo "held $file"; fi
done
echo '@@ end'
exit 0
"""
)


@dataclass(frozen=True)
class SharedFile:
    """One file. `held` says whether a live process holds the lock of the segment or port it belongs to."""

    name: str
    user_id: int
    size_bytes: int
    changed_s: int  # epoch seconds
    lockable: bool  # whether its lock file is there; without one nobody can tell whose it is
    held: bool
    holder: int = 0  # the process in /proc/locks, where it is visible
    removed: bool = False  # its holder holds it still, but nobody else can open it any more; it has no name, size nor owner

    @property
    def is_segment(self) -> bool:
        """Whether it is a participant's own segment: each has one, beside the ports that it opens."""
        return re.fullmatch(r"fast(rtps|dds)_[0-9a-f]+", self.name) is not None


_NAME = re.compile(r"(?:sem\.)?(fast(?:rtps|dds)_(?:port\d+|[0-9a-f]+))(?:_(?:el|sl|mutex))?")


def parse(output: Output) -> tuple[SharedFile, ...]:
    """Pure parser of PROBE. Raises ValueError."""
    said = answers(output)
    if not said.every("end"):
        raise ValueError("the probe ended before its last line")
    rows: list[tuple[int, int, int, int, str]] = []
    for line in said.lines("files"):
        words = line.split(None, 4)
        if len(words) != 5:
            raise ValueError(f"expected inode, user, size, time and name, found {line[:80]!r}")
        inode, user, size, changed = (integer(word, "a field of stat(1)") for word in words[:4])
        rows.append((inode, user, size, changed, words[4]))
    device = said.maybe("device")
    place = _device(device.text) if device is not None and device.text else None
    taken = _locks(said.lines("locks")) if said.maybe("locks") else []
    locks = {inode: holder for inode, holder, _ in taken}
    held: dict[str, int] = {}
    for inode, *_, name in rows:
        if name.endswith(("_el", "_sl")) and inode in locks:
            held[_owner(name)] = locks[inode]
    for line in said.lines("tried") if said.maybe("tried") else ():
        state, _, name = line.partition(" ")
        if state == "held":
            held.setdefault(_owner(name), 0)
    lockable = {_owner(name) for *_, name in rows if name.endswith(("_el", "_sl"))}
    named = {inode for inode, *_ in rows}
    return (
        *(
            SharedFile(name, user, size, changed, _owner(name) in lockable, _owner(name) in held, held.get(_owner(name), 0))
            for _, user, size, changed, name in rows
        ),
        *(
            SharedFile("", -1, 0, 0, lockable=True, held=True, holder=holder, removed=True)
            for inode, holder, where in taken
            if where == place and inode not in named
        ),
    )


def _owner(name: str) -> str:
    found = _NAME.fullmatch(name)
    return found[1] if found else name


def _device(text: str) -> tuple[int, int]:
    """Major and minor of what stat(1) prints as one hexadecimal number. Raises ValueError."""
    number = int(text, 16)
    return os.major(number), os.minor(number)


def _locks(lines: tuple[str, ...]) -> list[tuple[int, int, tuple[int, int]]]:
    """Inode, process and device of every flock in /proc/locks (proc(5)):
    `1: FLOCK ADVISORY WRITE 4242 00:1b:1679 0 EOF`."""
    found = []
    for line in lines:
        words = line.split()
        if len(words) >= 6 and words[1] == "FLOCK" and words[4].lstrip("-").isdigit() and words[5].count(":") == 2:
            major, minor, inode = words[5].split(":")
            if inode.isdigit():
                found.append((int(inode), int(words[4]), (int(major, 16), int(minor, 16))))
    return found


SHARED_MEMORY = Fact("shared-memory", PROBE, parse, at_once=True)
