"""What goes into an archive before it is masked, and what does not, with the reason."""

from __future__ import annotations

from typing import Any

from lupin_cli.quick_dataclass import dataclass

# Why something is not there. Only the last three mean that the archive has less than it could have.
ABSENT, TOO_BIG, UNREADABLE, UNREACHABLE, FAILED = "absent", "too big", "unreadable", "unreachable", "failed"
GAPS = frozenset({UNREADABLE, UNREACHABLE, FAILED})


@dataclass(frozen=True)
class Piece:
    """One file of the archive. `content` is bytes, or JSON-able data."""

    path: str  # below the archive's folder
    what: str
    content: bytes | Any
    remark: str = ""  # what is missing of it, and why


@dataclass(frozen=True)
class LeftOut:
    """Something that was looked for and isn't in the archive."""

    path: str
    kind: str
    reason: str
