"""Free space, free inodes and read-only state of the file systems that Lupin writes to."""

from __future__ import annotations

from dataclasses import dataclass

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, parse_sections

# Only these folders: df without arguments hangs on a network mount whose server is gone.
FOLDERS = "/ /home /tmp /var /var/log /dev/shm /run /boot"

PROBE = (
    PRELUDE
    + f"""set --
for p in {FOLDERS} "$HOME"; do [ -d "$p" ] && set -- "$@" "$p"; done
echo '@@ blocks'; df -Pk "$@"
echo '@@ inodes'; df -Pi "$@"
echo '@@ mounts'; cat /proc/self/mounts
echo '@@ end'
"""
)


@dataclass(frozen=True)
class Mount:
    """A file system that holds at least one of FOLDERS."""

    path: str
    device: str
    size_kb: int
    available_kb: int
    inodes: int  # 0 if the file system has no fixed number
    inodes_free: int
    read_only: bool
    raw: str  # df's line

    @property
    def used_fraction(self) -> float:
        """Share of the space that is not available to an ordinary user."""
        return 1.0 - self.available_kb / self.size_kb if self.size_kb else 0.0


@dataclass(frozen=True)
class Storage:
    """The file systems that hold FOLDERS, each once."""

    mounts: tuple[Mount, ...]


def parse(output: Output) -> Storage:
    """Parse the output of PROBE. Raises ValueError."""
    sections = parse_sections(output)
    sections.lines("end")
    options = {}
    for line in sections.lines("mounts"):
        words = line.split()
        if len(words) >= 4:
            options[words[1].replace("\\040", " ")] = words[3].split(",")  # the last mount on a path is the visible one
    inodes = {row[-1]: row for row in map(_row, sections.lines("inodes")[1:]) if row}
    mounts: dict[str, Mount] = {}
    for line in sections.lines("blocks")[1:]:
        row = _row(line)
        if not row:
            continue
        path = row[-1]
        counted = inodes.get(path)
        mounts[path] = Mount(
            path=path,
            device=row[0],
            size_kb=int(row[1]),
            available_kb=max(0, int(row[3])),
            inodes=int(counted[1]) if counted and counted[1].isdigit() else 0,
            inodes_free=int(counted[3]) if counted and counted[3].isdigit() else 0,
            read_only="ro" in options.get(path, ()),
            raw=line,
        )
    if not mounts:
        raise ValueError(f"expected lines of df, found {output.stdout[:80]!r}; stderr {output.stderr.strip()[:120]!r}")
    return Storage(tuple(mounts.values()))


def _row(line: str) -> list[str] | None:
    """Return the six columns of a POSIX df line, or None; device and mount point may contain spaces."""
    words = line.split()
    at = next(
        (i for i, word in enumerate(words) if i >= 4 and (word.endswith("%") or word == "-") and i + 1 < len(words)), None
    )
    if at is None or not words[at - 3].lstrip("-").isdigit():
        return None
    return [" ".join(words[: at - 3]), *words[at - 3 : at + 1], " ".join(words[at + 1 :])]


STORAGE = Fact("storage", PROBE, parse)
