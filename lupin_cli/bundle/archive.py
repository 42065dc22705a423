"""The archive: masks and truncates the items, adds a manifest, packs them, and writes the file completely or not at all."""

from __future__ import annotations

import contextlib
import gzip
import hashlib
import io
import os
import re
import secrets
import tarfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lupin_cli.bundle.items import FAILED, TOO_BIG, BundleItem, Omission, encode, truncate_bytes
from lupin_cli.bundle.redact import Redactor, dump_json

MAX_FILE_BYTES = 2_000_000
MAX_JSON_BYTES = 8_000_000  # JSON cannot be truncated
MAX_TOTAL_BYTES = 48_000_000
_MIN_TRUNCATED_BYTES = 1000  # below this, an item is left out instead of truncated
FORMAT = 1

README = """A support archive of Lupin, made by `lupin bundle`.

Start with findings/, which has the findings of `lupin doctor`. manifest.json describes each file, what was left out and why,
and how much was masked. laptop/ is the machine that made this archive, robots/NAME/ is each robot: facts.json has the facts,
probes/ the output that they were parsed from, and the other folders system journals, settings and state.

Passwords, keys and tokens are replaced by ***. Names of wireless networks (ssid-1), hardware addresses (02:6d:61:63:..), public
addresses (198.18.0.., 2001:db8::..), SSH keys and fingerprints are replaced by pseudonyms, which are the same in all files.
Private addresses are kept, since a diagnosis needs them.{users}

Masking follows rules and may miss something. Look through the archive before you send it on.
"""


@dataclass(frozen=True)
class Member:
    """One file of the archive as it is written."""

    path: str
    description: str
    data: bytes
    remark: str = ""

    def manifest_row(self) -> dict[str, Any]:
        """Return its entry in the manifest."""
        digest = hashlib.sha256(self.data).hexdigest()
        row = {"path": self.path, "what": self.description, "bytes": len(self.data), "sha256": digest}
        return {**row, "incomplete": self.remark} if self.remark else row


@dataclass(frozen=True)
class Contents:
    """Everything in an archive; the first two members are the README and the manifest."""

    members: tuple[Member, ...]
    omissions: tuple[Omission, ...]
    masked: dict[str, int]  # number of masked places, by kind

    @property
    def size(self) -> int:
        """The size in bytes before compression."""
        return sum(len(member.data) for member in self.members)


def assemble(
    items: Sequence[BundleItem],
    omissions: Iterable[Omission],
    redactor: Redactor,
    about: Mapping[str, Any],
    total: int = MAX_TOTAL_BYTES,
) -> Contents:
    """Mask every item with the secrets of all items, truncate what is too long, and write the manifest. Pure.

    Items are taken in order until `total` bytes are used. `about` is the first part of the manifest.
    """
    for item in items:
        _learn(redactor, item)
    members: list[Member] = []
    left_out = list(omissions)
    room = total
    for item in items:
        try:
            found = _member(redactor, item, room)
        except (RecursionError, MemoryError) as error:
            # An item that is too deep or too large to be masked must neither be archived unmasked nor stop the others.
            found = Omission(item.path, FAILED, f"it cannot be masked: {type(error).__name__}")
        if isinstance(found, Member):
            members.append(found)
            room -= len(found.data)
        else:
            left_out.append(found)
    masked_omissions = tuple(
        Omission(_safe_path(redactor.redact_text(each.path)), each.kind, redactor.redact_text(each.reason))
        for each in sorted(left_out, key=lambda each: each.path)
    )
    masked_about = redactor.redact_data(about)
    manifest = {
        "format": FORMAT,
        **masked_about,
        "files": [member.manifest_row() for member in members],
        "left_out": [{"path": each.path, "kind": each.kind, "reason": each.reason} for each in masked_omissions],
        "masked": redactor.masked,
    }
    users = " User names in home paths are masked as well." if redactor.users else ""
    head = (
        Member("README.txt", "what this archive is", README.format(users=users).encode()),
        Member("manifest.json", "what each file is, and what was left out", encode(dump_json(manifest))),
    )
    return Contents((*head, *members), masked_omissions, redactor.masked)


def _learn(redactor: Redactor, item: BundleItem) -> None:
    if isinstance(item.content, bytes):
        redactor.learn_file(item.content, item.path)
    else:
        redactor.learn(item.content)
    redactor.learn(item.remark)


def _member(redactor: Redactor, item: BundleItem, room: int) -> Member | Omission:
    path, remark = _safe_path(redactor.redact_text(item.path)), redactor.redact_text(item.remark)
    if isinstance(item.content, bytes):
        data = redactor.redact_file(item.content, item.path)
    else:
        data = encode(dump_json(redactor.redact_data(item.content)))
    is_json = path.endswith((".json", ".jsonl"))
    limit = min(room, MAX_JSON_BYTES if is_json else MAX_FILE_BYTES)
    if len(data) <= limit:
        return Member(path, item.description, data, remark)
    if is_json or limit < _MIN_TRUNCATED_BYTES:
        reason = "the archive is full" if limit == room else f"the limit is {limit}"
        return Omission(path, TOO_BIG, f"it has {len(data)} bytes; {reason}")
    cut = truncate_bytes(data, limit)
    truncated = f"{cut.missing} were left out of the middle"
    return Member(path, item.description, cut.data, "; ".join(filter(None, (remark, truncated))))


def _safe_path(path: str) -> str:
    """Return a relative path that unpacks inside the archive's folder, whatever names a machine gave its files."""
    parts = [re.sub(r"[^\w.@:+=,-]+", "_", part, flags=re.ASCII).lstrip(".") or "_" for part in path.split("/") if part]
    return "/".join(part[:120] for part in parts)


# -- the file on disk


class CannotWrite(Exception):
    """The archive cannot be written; the message says why and what to do."""


def pack(members: Iterable[Member], folder: str, time_s: float) -> bytes:
    """Pack the members below `folder` into a gzipped tar. Equal members give equal bytes."""
    packed = io.BytesIO()
    with (
        gzip.GzipFile(filename="", mode="wb", fileobj=packed, mtime=int(time_s)) as stream,
        tarfile.open(fileobj=stream, mode="w", format=tarfile.PAX_FORMAT) as tar,
    ):
        for member in members:
            entry = tarfile.TarInfo(f"{folder}/{member.path}")
            entry.size, entry.mtime, entry.mode = len(member.data), int(time_s), 0o600
            tar.addfile(entry, io.BytesIO(member.data))
    return packed.getvalue()


def check_writable(path: Path, *, force: bool) -> None:
    """Check that the archive can be written to `path`, before minutes are spent on making it. Raises CannotWrite."""
    if not path.parent.is_dir():
        raise CannotWrite(f"there is no folder {path.parent}; create it, or choose another file with --out")
    if path.is_dir():
        raise CannotWrite(f"{path} is a folder; name a file in it: --out {path / 'lupin-bundle.tar.gz'}")
    if not force and os.path.lexists(path):
        raise CannotWrite(f"{path} exists; choose another file with --out, or overwrite it with --force")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise CannotWrite(f"no permission to write in {path.parent}; choose another file with --out")


def write(path: Path, data: bytes, *, force: bool) -> None:
    """Write a file with mode 0600 under a temporary name, and rename it when the data is on disk. Raises CannotWrite."""
    partial = path.with_name(f".{path.name}.{secrets.token_hex(4)}.partial")
    try:
        try:
            descriptor = os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
            with os.fdopen(descriptor, "wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            _rename(partial, path, force)
        finally:
            with contextlib.suppress(FileNotFoundError):
                partial.unlink()
        _sync(path.parent)
    except FileExistsError as error:
        raise CannotWrite(f"{path} exists; overwrite it with --force") from error
    except OSError as error:
        action = "free some space, or choose" if error.errno in _DISK_FULL else "choose"
        raise CannotWrite(f"{path} cannot be written: {error.strerror}; {action} another file with --out") from error


_DISK_FULL = (28, 122)  # ENOSPC, EDQUOT


def _rename(partial: Path, path: Path, force: bool) -> None:
    if force:
        partial.replace(path)
        return
    try:
        os.link(partial, path)  # unlike rename, it never replaces another file
    except FileExistsError:
        raise
    except OSError:
        # The file system has no hard links, as on a USB stick.
        if os.path.lexists(path):
            raise FileExistsError(path) from None
        partial.rename(path)


def _sync(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        with contextlib.suppress(OSError):  # not supported by every file system, and the file is complete anyway
            os.fsync(descriptor)
    finally:
        os.close(descriptor)
