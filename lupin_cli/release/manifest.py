"""The manifest of a release: paths, hashes and modes of its files. Releases with the same files have the same id."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from lupin_runtime.atomic_file import write_atomically
from lupin_runtime.json_text import parse_json

ID_DIGITS = 12


@dataclass(frozen=True)
class Entry:
    """One file of a release.

    path: relative to the release.
    source: the content (bytes), or the path of the file on this machine (str).
    """

    path: str
    source: str | bytes = field(compare=False)
    sha256: str
    size: int
    executable: bool

    def read(self) -> bytes:
        """Return the content."""
        return self.source if isinstance(self.source, bytes) else Path(self.source).read_bytes()


@dataclass(frozen=True)
class Manifest:
    """The files of a release, sorted by path."""

    entries: tuple[Entry, ...]

    @property
    def id(self) -> str:
        """The release's id: the first digits of the hash of everything in it."""
        digest = hashlib.sha256()
        for entry in self.entries:
            digest.update(f"{entry.sha256} {int(entry.executable)} {entry.path}\n".encode())
        return digest.hexdigest()[:ID_DIGITS]

    @property
    def digest(self) -> str:
        """The SHA-256 of `text`, by which a robot's manifest is recognized."""
        return hashlib.sha256(self.text().encode()).hexdigest()

    @property
    def size_bytes(self) -> int:
        """The size of all files together."""
        return sum(entry.size for entry in self.entries)

    def text(self) -> str:
        """Return the manifest in the format of `sha256sum --check`: one line per file, in C order of the paths."""
        return "".join(f"{entry.sha256}  {entry.path}\n" for entry in sorted(self.entries, key=lambda e: e.path.encode()))


class HashCache:
    """SHA-256 of files, cached by inode, size and modification times, so that a second deploy reads no unchanged file."""

    def __init__(self, cache: Path) -> None:
        self._cache = cache
        try:
            self._known: dict[str, list[str]] = parse_json(cache.read_text())
        except (OSError, ValueError):
            self._known = {}  # without a readable cache all files are hashed again
        self._changed = False

    def sha256(self, path: str, stat: os.stat_result) -> str:
        """Return the SHA-256 of a file with this stat result, from the cache if possible."""
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
        """Write the cache file if a hash was added."""
        if not self._changed:
            return
        self._cache.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(self._cache, json.dumps(self._known))


def build_manifest(files: Iterable[tuple[str, str | bytes]], hashes: HashCache) -> Manifest:
    """Build the manifest of `files`, which are pairs `(path in the release, path on this machine or content)`.

    Raises ValueError for a path that is absolute, leaves the release, is not printable, or occurs twice.
    """
    entries = []
    for path, source in files:
        if path.startswith("/") or ".." in path.split("/") or "\n" in path or "\\" in path:
            raise ValueError(f"{path!r} cannot be a path in a release: expected a relative, printable path")
        if isinstance(source, bytes):
            entries.append(Entry(path, source, hashlib.sha256(source).hexdigest(), len(source), False))
            continue
        stat = os.stat(source)  # noqa: PTH116 -- creating four thousand Paths takes longer than reading their files
        executable = bool(stat.st_mode & 0o100)
        entries.append(Entry(path, source, hashes.sha256(source, stat), stat.st_size, executable))
    hashes.save()
    paths = [entry.path for entry in entries]
    if len(set(paths)) != len(paths):
        twice = sorted({path for path in paths if paths.count(path) > 1})
        raise ValueError(f"{twice[0]} occurs twice in the release")
    return Manifest(tuple(sorted(entries, key=lambda entry: entry.path)))
