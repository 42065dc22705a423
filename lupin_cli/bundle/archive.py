"""The archive on the disk: whole and readable by its owner only, or not at all."""

from __future__ import annotations

import contextlib
import gzip
import io
import os
import secrets
import tarfile
from collections.abc import Iterable
from pathlib import Path

from lupin_cli.bundle.assembly import Member


class CannotWrite(Exception):
    """The archive can't be written, and what to do about it."""


def pack(members: Iterable[Member], folder: str, time_s: float) -> bytes:
    """A gzipped tar of the members below `folder`; the same members give the same bytes."""
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


def check_place(path: Path, *, force: bool) -> None:
    """Whether something could be written there, before minutes are spent on it. Raises CannotWrite."""
    if not path.parent.is_dir():
        raise CannotWrite(f"there is no folder {path.parent}; make it, or name another place with --out")
    if path.is_dir():
        raise CannotWrite(f"{path} is a folder; name a file in it: --out {path / 'lupin-bundle.tar.gz'}")
    if not force and os.path.lexists(path):
        raise CannotWrite(f"{path} is there already; name another file with --out, or write over it with --force")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise CannotWrite(f"nothing can be written in {path.parent}; name another place with --out")


def write(path: Path, data: bytes, *, force: bool) -> None:
    """Write a file with mode 0600 under another name, and give it its own when the disk has it. Raises CannotWrite."""
    partial = path.with_name(f".{path.name}.{secrets.token_hex(4)}.partial")
    try:
        try:
            descriptor = os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
            with os.fdopen(descriptor, "wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            _name(partial, path, force)
        finally:
            with contextlib.suppress(FileNotFoundError):
                partial.unlink()
        _sync(path.parent)
    except FileExistsError as error:
        raise CannotWrite(f"{path} is there already; write over it with --force") from error
    except OSError as error:
        free = (
            "; free some space, or name another place with --out" if error.errno in _FULL else "; name another place with --out"
        )
        raise CannotWrite(f"{path} can't be written: {error.strerror}{free}") from error


_FULL = (28, 122)  # ENOSPC, EDQUOT


def _name(partial: Path, path: Path, force: bool) -> None:
    if force:
        partial.replace(path)
        return
    try:
        os.link(partial, path)  # unlike a rename it never takes another file's place
    except FileExistsError:
        raise
    except OSError:
        # A file system without hard links, such as a USB stick's.
        if os.path.lexists(path):
            raise FileExistsError(path) from None
        partial.rename(path)


def _sync(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        with contextlib.suppress(OSError):  # some file systems can't, and the file is there
            os.fsync(descriptor)
    finally:
        os.close(descriptor)
