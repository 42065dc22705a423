"""From pieces to the archive's files: masked, bounded, and told by a manifest. Pure."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from lupin_cli.bundle import ends
from lupin_cli.bundle.pieces import FAILED, TOO_BIG, LeftOut, Piece
from lupin_cli.bundle.redaction import Redactor, dumped
from lupin_cli.quick_dataclass import dataclass

FILE_LIMIT = 2_000_000
JSON_LIMIT = 8_000_000  # can't be cut and stay JSON
TOTAL_LIMIT = 48_000_000
FORMAT = 1

README = """A support archive of Lupin, made by `lupin bundle`.

manifest.json says what each file is, what was left out and why, and how much was masked.
findings/ holds what `lupin doctor` found; begin there.
laptop/ is the machine that made this, robots/NAME/ each robot: facts.json as they were understood, probes/ as the machine
printed them, and journals, settings and state beside them.

Passwords, keys, tokens and the like are replaced by ***. Names of wireless networks (ssid-1), hardware addresses
(02:6d:61:63:..), public addresses (198.18.0.., 2001:db8::..), SSH keys and fingerprints have other names, the same throughout
this archive. Private addresses stay, since they are the evidence.{users}

Masking goes by rules. Whoever sends this on should look through it first.
"""


@dataclass(frozen=True)
class Member:
    """One file of the archive as it is written."""

    path: str
    what: str
    data: bytes
    remark: str = ""

    def row(self) -> dict[str, Any]:
        """Its line in the manifest."""
        digest = hashlib.sha256(self.data).hexdigest()
        said = {"path": self.path, "what": self.what, "bytes": len(self.data), "sha256": digest}
        return {**said, "incomplete": self.remark} if self.remark else said


@dataclass(frozen=True)
class Contents:
    """All that an archive holds; the first two members are the README and the manifest."""

    members: tuple[Member, ...]
    left_out: tuple[LeftOut, ...]
    masked: dict[str, int]

    @property
    def size(self) -> int:
        """Bytes before compression."""
        return sum(len(member.data) for member in self.members)


def assemble(
    pieces: Sequence[Piece], left_out: Iterable[LeftOut], redactor: Redactor, about: Mapping[str, Any], total: int = TOTAL_LIMIT
) -> Contents:
    """Mask every piece with what all of them tell, cut what is too long, and write the manifest.

    Pieces are taken in their order until `total` bytes are full. `about` is what the manifest says first.
    """
    for piece in pieces:
        _learn(redactor, piece)
    members: list[Member] = []
    missing = list(left_out)
    room = total
    for piece in pieces:
        try:
            found = _member(redactor, piece, room)
        except (RecursionError, MemoryError) as error:
            # Whatever is too deep or too large to be masked must not go in unmasked, nor cost the others.
            found = LeftOut(piece.path, FAILED, f"it can't be masked: {type(error).__name__}")
        if isinstance(found, Member):
            members.append(found)
            room -= len(found.data)
        else:
            missing.append(found)
    told = tuple(
        LeftOut(_safe(redactor.text(each.path)), each.kind, redactor.text(each.reason))
        for each in sorted(missing, key=lambda e: e.path)
    )
    safe_about = redactor.data(about)
    manifest = {
        "format": FORMAT,
        **safe_about,
        "files": [member.row() for member in members],
        "left_out": [{"path": each.path, "kind": each.kind, "reason": each.reason} for each in told],
        "masked": redactor.masked,
    }
    users = " Names in home paths are masked as well." if redactor.users else ""
    head = (
        Member("README.txt", "what this is", README.format(users=users).encode()),
        Member(
            "manifest.json", "what each file is, and what was left out", dumped(manifest).encode("utf-8", "surrogateescape")
        ),
    )
    return Contents((*head, *members), told, redactor.masked)


def _learn(redactor: Redactor, piece: Piece) -> None:
    if isinstance(piece.content, bytes):
        redactor.learn_file(piece.content, piece.path)
    else:
        redactor.learn(piece.content)
    redactor.learn(piece.remark)


def _member(redactor: Redactor, piece: Piece, room: int) -> Member | LeftOut:
    path, remark = _safe(redactor.text(piece.path)), redactor.text(piece.remark)
    if isinstance(piece.content, bytes):
        data = redactor.file(piece.content, piece.path)
    else:
        data = dumped(redactor.data(piece.content)).encode("utf-8", "surrogateescape")
    limit = min(room, JSON_LIMIT if path.endswith((".json", ".jsonl")) else FILE_LIMIT)
    if len(data) <= limit:
        return Member(path, piece.what, data, remark)
    if path.endswith((".json", ".jsonl")) or limit < 1000:
        full = "the archive is full" if limit == room else f"at most {limit} go in"
        return LeftOut(path, TOO_BIG, f"it has {len(data)} bytes; {full}")
    cut = ends.of_bytes(data, limit)
    return Member(path, piece.what, cut.data, "; ".join(filter(None, (remark, f"{cut.left_out} of its middle are left out"))))


def _safe(path: str) -> str:
    """A path within the archive: what unpacks it must land where it should, whatever a machine called its files."""
    parts = [re.sub(r"[^\w.@:+=,-]+", "_", part, flags=re.ASCII).lstrip(".") or "_" for part in path.split("/") if part]
    return "/".join(part[:120] for part in parts)
