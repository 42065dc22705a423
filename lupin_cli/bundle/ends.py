"""The head and the tail of what is too long: how it began and how it ended tell more than its middle.

Cuts are made where a line ends, before anything is masked: half a line could hide that the rest of it is a secret.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

from lupin_cli.quick_dataclass import dataclass

HEAD_SHARE = 4  # a quarter of what is kept is head


@dataclass(frozen=True)
class Ends:
    """What is kept of something. `left_out` says how many bytes are not there, in words; empty where all is."""

    data: bytes
    left_out: str = ""


def join(head: bytes, tail: bytes, left_out: str) -> Ends:
    """Head and tail with a line between them that says what isn't there; both lose the line that was cut."""
    upto = max(head.rfind(b"\n"), -1) + 1 or max(head.rfind(b" "), 0)
    begin = tail.find(b"\n") + 1  # a tail without any line's end is the rest of one line: nobody knows of what
    kept = tail[begin:] if begin else b""
    return Ends(head[:upto].rstrip(b"\n") + f"\n[... {left_out} left out here ...]\n".encode() + kept, left_out)


def of_bytes(data: bytes, limit: int) -> Ends:
    """At most about `limit` bytes of `data`."""
    if len(data) <= limit:
        return Ends(data)
    head = limit // HEAD_SHARE
    return join(data[:head], data[len(data) - (limit - head) :], f"{len(data) - limit} bytes")


def of_file(path: Path, limit: int) -> Ends:
    """At most about `limit` bytes of a file, however long it is, read without waiting. Raises OSError."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY)
    try:
        found = os.fstat(descriptor)
        if not stat.S_ISREG(found.st_mode):
            raise OSError(0, "it is no regular file")
        if found.st_size <= limit:
            return of_bytes(_read(descriptor, limit + 1, 0), limit)
        head = limit // HEAD_SHARE
        tail = limit - head
        return join(_read(descriptor, head, 0), _read(descriptor, tail, found.st_size - tail), f"{found.st_size - limit} bytes")
    finally:
        os.close(descriptor)


def _read(descriptor: int, count: int, offset: int) -> bytes:
    data = b""
    while len(data) < count and (piece := os.pread(descriptor, count - len(data), offset + len(data))):
        data += piece
    return data
