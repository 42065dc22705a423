"""Items of a support archive, omissions with their reasons, and the truncation of long texts."""

from __future__ import annotations

import os
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import Any

# Kinds of omissions. Only those in GAPS mean that the archive has less than it could have.
ABSENT, TOO_BIG, UNREADABLE, UNREACHABLE, FAILED = "absent", "too big", "unreadable", "unreachable", "failed"
GAPS = frozenset({UNREADABLE, UNREACHABLE, FAILED})

_HEAD_DIVISOR = 4  # a quarter of a truncated text is its head, the rest its tail


def encode(text: str) -> bytes:
    """Encode as UTF-8; restore bytes that were not UTF-8 when the text was read."""
    return text.encode("utf-8", "surrogateescape")


@dataclass(frozen=True)
class BundleItem:
    """One file of the archive before masking. `content` is bytes, or JSON-serializable data."""

    path: str  # below the archive's folder
    description: str
    content: bytes | Any
    remark: str = ""  # what is missing from it, and why


@dataclass(frozen=True)
class Omission:
    """Something that was looked for and is not in the archive."""

    path: str
    kind: str  # ABSENT, TOO_BIG, UNREADABLE, UNREACHABLE or FAILED
    reason: str


@dataclass(frozen=True)
class Truncated:
    """The head and the tail of a text: its start and its end explain more than its middle.

    `missing` is the size of the missing middle in words; empty if nothing is missing. Cuts are made at line ends and before
    masking: half a line may not show that it contains a secret.
    """

    data: bytes
    missing: str = ""


def join_ends(head: bytes, tail: bytes, missing: str) -> Truncated:
    """Join head and tail with a line that says how much is missing. The incomplete line of each is dropped."""
    head_end = max(head.rfind(b"\n"), -1) + 1 or max(head.rfind(b" "), 0)
    tail_start = tail.find(b"\n") + 1  # a tail without a newline is the rest of one line, with unknown meaning
    kept = tail[tail_start:] if tail_start else b""
    return Truncated(head[:head_end].rstrip(b"\n") + f"\n[... {missing} left out here ...]\n".encode() + kept, missing)


def truncate_bytes(data: bytes, limit: int) -> Truncated:
    """Truncate `data` to about `limit` bytes."""
    if len(data) <= limit:
        return Truncated(data)
    head = limit // _HEAD_DIVISOR
    return join_ends(data[:head], data[len(data) - (limit - head) :], f"{len(data) - limit} bytes")


def truncate_file(path: Path, limit: int) -> Truncated:
    """Read about `limit` bytes of a regular file of any size, without blocking. Raises OSError."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY)
    try:
        found = os.fstat(descriptor)
        if not stat.S_ISREG(found.st_mode):
            raise OSError(0, "not a regular file")
        if found.st_size <= limit:
            return truncate_bytes(_read(descriptor, limit + 1, 0), limit)
        head = limit // _HEAD_DIVISOR
        tail = limit - head
        missing = f"{found.st_size - limit} bytes"
        return join_ends(_read(descriptor, head, 0), _read(descriptor, tail, found.st_size - tail), missing)
    finally:
        os.close(descriptor)


def _read(descriptor: int, count: int, offset: int) -> bytes:
    data = b""
    while len(data) < count and (chunk := os.pread(descriptor, count - len(data), offset + len(data))):
        data += chunk
    return data
