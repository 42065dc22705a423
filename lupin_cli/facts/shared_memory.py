"""The files of Fast DDS in /dev/shm, and whether a live process holds them.

Fast DDS locks `<segment>_el` and `<port>_el` with flock(2) while their owner lives (measured with 2.14: WRITE locks in
/proc/locks). A file with a free lock is stale and one with a held lock is in use, however old it is.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, integer, parse_sections

# Locks of processes in other PID namespaces (containers) are not in /proc/locks, but flock(1) fails on them. The probe opens
# files without creating them and does not wait. A process that checks the lock meanwhile sees a file in use and keeps it.
# Everybody may write in /dev/shm: a link could lead elsewhere, and opening a FIFO could take forever, so only files are opened.
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
  [ -f "$file" ] && [ ! -L "$file" ] || continue
  if ( flock -n -x 9 ) 9<"$file" 2>/dev/null; then echo "free $file"; else echo "held $file"; fi
done
echo '@@ end'
exit 0
"""
)


@dataclass(frozen=True)
class SharedFile:
    """One file. `held` is whether a live process holds the lock of its segment or port."""

    name: str
    user_id: int
    size_bytes: int
    changed_s: int  # epoch seconds
    lockable: bool  # whether its lock file exists; without one, its owner is unknown
    held: bool
    holder: int = 0  # PID of the holder in /proc/locks; 0 if it is not visible
    removed: bool = False  # deleted while held: others can no longer open it, and its name, size and owner are unknown

    @property
    def is_segment(self) -> bool:
        """Whether it is a participant's own segment. Each participant has one, besides its ports."""
        return re.fullmatch(r"fast(rtps|dds)_[0-9a-f]+", self.name) is not None


_NAME = re.compile(r"(?:sem\.)?(fast(?:rtps|dds)_(?:port\d+|[0-9a-f]+))(?:_(?:el|sl|mutex))?")


def parse(output: Output) -> tuple[SharedFile, ...]:
    """Parse the output of PROBE. Raises ValueError."""
    sections = parse_sections(output)
    if not sections.all("end"):
        raise ValueError("the probe's output has no last line: it was cut off")
    rows: list[tuple[int, int, int, int, str]] = []
    for line in sections.lines("files"):
        words = line.split(None, 4)
        if len(words) != 5:
            raise ValueError(f"expected inode, user, size, time and name, found {line[:80]!r}")
        inode, user, size, changed = (integer(word, "a field of stat(1)") for word in words[:4])
        rows.append((inode, user, size, changed, words[4]))
    device = sections.get("device")
    shm_device = _device(device.text) if device is not None and device.text else None
    flocks = _locks(sections.lines("locks")) if sections.get("locks") else []
    # Inodes are numbered by file system: the /dev/shm of a container has the same ones.
    locks = {inode: holder for inode, holder, number in flocks if shm_device in (None, number)}
    held: dict[str, int] = {}
    for inode, *_, name in rows:
        if name.endswith(("_el", "_sl")) and inode in locks:
            held[_owner(name)] = locks[inode]
    for line in sections.lines("tried") if sections.get("tried") else ():
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
            for inode, holder, device_number in flocks
            if device_number == shm_device and inode not in named
        ),
    )


def _owner(name: str) -> str:
    """Return the segment or port that a file belongs to."""
    found = _NAME.fullmatch(name)
    return found[1] if found else name


def _device(text: str) -> tuple[int, int]:
    """Return the major and minor number of a device that stat(1) printed in hexadecimal. Raises ValueError."""
    number = int(text, 16)
    return os.major(number), os.minor(number)


def _locks(lines: tuple[str, ...]) -> list[tuple[int, int, tuple[int, int]]]:
    """Return inode, PID and device of each flock in /proc/locks, such as `1: FLOCK ADVISORY WRITE 4242 00:1b:1679 0 EOF`."""
    found = []
    for line in lines:
        words = line.split()
        if len(words) >= 6 and words[1] == "FLOCK" and words[4].lstrip("-").isdigit() and words[5].count(":") == 2:
            major, minor, inode = words[5].split(":")
            if inode.isdigit():
                found.append((int(inode), int(words[4]), (int(major, 16), int(minor, 16))))
    return found


SHARED_MEMORY = Fact("shared-memory", PROBE, parse, runs_in_shared_shell=True)
