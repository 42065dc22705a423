"""What a release consists of: paths, contents, modes. Two releases with the same files have the same name."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable
from dataclasses import field
from pathlib import Path

from lupin_cli.quick_dataclass import dataclass

ID_DIGITS = 12


@dataclass(frozen=True)
class Entry:
    """A file of a release: its path below the release, its content or where that lies here, SHA-256 of it, whether it runs."""

    path: str
    source: str | bytes = field(compare=False)
    sha256: str
    size: int
    executable: bool

    def read(self) -> bytes:
        return self.source if isinstance(self.source, bytes) else Path(self.source).read_bytes()


@dataclass(frozen=True)
class Manifest:
    """The files of a release in order of their paths."""

    entries: tuple[Entry, ...]

    @property
    def id(self) -> str:
        """The release's name: digits of the hash of everything in it."""
        digest = hashlib.sha256()
        for entry in self.entries:
            digest.update(f"{entry.sha256} {int(entry.executable)} {entry.path}\n".encode())
        return digest.hexdigest()[:ID_DIGITS]

    @property
    def size_bytes(self) -> int:
        return sum(entry.size for entry in self.entries)

    def text(self) -> str:
        """As `sha256sum --check` reads it, one line a file, in C order."""
        return "".join(f"{entry.sha256}  {entry.path}\n" for entry in sorted(self.entries, key=lambda e: e.path.encode()))


class Hashes:
    """SHA-256 of files, remembered by inode, size and time of change, so that the second deploy reads nothing again."""

    def __init__(self, cache: Path) -> None:
        self._cache = cache
        try:
            self._known: dict[str, list[str]] = json.loads(cache.read_text())
        except (OSError, ValueError):
            self._known = {}  # a lost or torn cache costs time only
        self._changed = False

    def of(self, path: str, stat: os.stat_result) -> str:
        state = f"{stat.st_ino} {stat.st_size} {stat.st_mtime_ns} {stat.st_ctime_ns}"
        known = self._known.get(path)
        if known and known[0] == state:
            return known[1]
        with Path(path).open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        self._known[path] = [state, digest]
        self._changed = True
        return digest

    def save(self) -> None:
        if not self._changed:
            return
        self._cache.parent.mkdir(parents=True, exist_ok=True)
        new = self._cache.with_suffix(f".{os.getpid()}")
        new.write_text(json.dumps(self._known))
        new.replace(self._cache)


def manifest_of(files: Iterable[tuple[str, str | bytes]], hashes: Hashes) -> Manifest:
    """The manifest of `(path in the release, file here or content)` pairs; raises ValueError for a path that isn't plain."""
    entries = []
    for path, source in files:
        if path.startswith("/") or ".." in path.split("/") or "\n" in path or "\\" in path:
            raise ValueError(f"{path!r} can't be a path of a release: it must be relative and printable")
        if isinstance(source, bytes):
            entries.append(Entry(path, source, hashlib.sha256(source).hexdigest(), len(source), False))
            continue
        stat = os.stat(source)  # noqa: PTH116 -- four thousand Paths cost more than their files
        executable = bool(stat.st_mode & 0o100)
        entries.append(Entry(path, source, hashes.of(source, stat), stat.st_size, executable))
    hashes.save()
    paths = [entry.path for entry in entries]
    if len(set(paths)) != len(paths):
        twice = sorted({path for path in paths if paths.count(path) > 1})
        raise ValueError(f"a release can't hold {twice[0]} twice")
    return Manifest(tuple(sorted(entries, key=lambda entry: entry.path)))
