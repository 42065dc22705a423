"""The files of the certificate authority and of the server certificate.

They are in `${XDG_STATE_HOME:-~/.local/state}/lupin/certificate/`, a folder that only its owner can access. `authority.pem` and
`server.pem` each contain a key together with its certificates, so that the two always match; `authority.crt` is the root, for
devices to install. A lock makes processes that start at the same time use the same certificates.
"""

from __future__ import annotations

import contextlib
import datetime
import fcntl
import os
import stat
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from lupin_runtime.atomic_file import write_atomically
from lupin_runtime.console.certificate import certificate_authority, leaf
from lupin_runtime.console.certificate.certificate_authority import CertificateAuthority, DamagedAuthority
from lupin_runtime.console.certificate.leaf import Leaf
from lupin_runtime.console.host_addresses import HostAddresses, host_addresses
from lupin_runtime.stack.runs import make_state_folder, state_directory

LOCK_TIMEOUT_S = 10.0
_LOCK_PERIOD_S = 0.02
_MAX_BYTES = 64 * 1024
NEXT_COMMAND = "lupin console certificate"


class CertificateError(RuntimeError):
    """No certificate can be read or created; the message says why, and what to do."""


@dataclass(frozen=True)
class Certificates:
    """The stored authority and server certificate.

    `renewed` is the reason if the leaf has just been replaced, else None. `notes` are sentences for the operator. `omitted` are
    names and addresses of this host for which only a new authority could issue a certificate.
    """

    authority: CertificateAuthority
    leaf: Leaf
    renewed: str | None
    notes: tuple[str, ...]
    omitted: tuple[str, ...]


def _now() -> datetime.datetime:
    return datetime.datetime.now(datetime.timezone.utc)


class CertificateStore:
    """Creates, loads and renews the certificates. `clock` returns aware times, `reachable` the host's names and addresses."""

    def __init__(
        self,
        folder: Path | None = None,
        clock: Callable[[], datetime.datetime] = _now,
        reachable: Callable[[], HostAddresses] = host_addresses,
    ) -> None:
        self.folder = state_directory() / "certificate" if folder is None else folder
        self.authority_path = self.folder / "authority.pem"
        self.root_path = self.folder / "authority.crt"
        self.server_path = self.folder / "server.pem"
        self._clock = clock
        self._reachable = reachable

    def peek(self) -> CertificateAuthority | None:
        """Return the stored authority; None if there is none or it is damaged. Changes nothing. Raises CertificateError."""
        with _explained(self.folder):
            if not self.folder.is_dir():
                return None
            self._check_owner()
            try:
                return self._load_authority()
            except DamagedAuthority:
                return None

    def ensure(self, *, new_authority: bool = False) -> Certificates:
        """Load the certificates; create, repair or renew them if necessary. With `new_authority`, replace all of them.

        Raises CertificateError if the files cannot be read or written.
        """
        with _explained(self.folder), self._lock():
            reachable, clock = self._reachable(), self._clock()
            authority, notes = self._authority(reachable, new_authority)
            before, leaf_notes = self._load_leaf()
            notes += leaf_notes
            reason = leaf.reason_to_renew(before, authority, reachable, clock)
            current = before
            if current is None or reason is not None:
                current = leaf.issue(authority, reachable, clock, before)
                write_atomically(self.server_path, current.pem(), mode=0o600, sync=True)
        if not leaf.is_plausible(clock):
            notes.append(
                f"this machine's clock shows {clock:%Y-%m-%d}, which is wrong: browsers on it refuse the certificate, and "
                "those on other devices may too; set the clock, on a robot with: lupin sync-clock"
            )
        candidates = (*filter(certificate_authority.is_permittable, reachable.names), *reachable.addresses)
        omitted = tuple(str(subject) for subject in candidates if not authority.permits(subject))
        return Certificates(authority, current, reason, tuple(notes), omitted)

    # -- the authority ------------------------------------------------------------------------------------------------
    def _authority(self, reachable: HostAddresses, renew: bool) -> tuple[CertificateAuthority, list[str]]:
        notes: list[str] = []
        authority = None
        try:
            authority = self._load_authority(notes)
        except DamagedAuthority as error:
            notes.append(
                f"the certificate authority in {self.authority_path} was not usable ({error}) and was replaced; "
                f"install the new one on every device that trusted it: {NEXT_COMMAND}"
            )
        if authority is None or renew:
            authority = certificate_authority.create(reachable)
            write_atomically(self.authority_path, authority.pem(), mode=0o600, sync=True)
        if not self._holds(self.root_path, authority.root_pem()):
            write_atomically(self.root_path, authority.root_pem())
        return authority, notes

    def _load_authority(self, notes: list[str] | None = None) -> CertificateAuthority | None:
        """Load the authority, and protect its key if necessary; None if there is no file. Raises DamagedAuthority."""
        try:
            data, mode = _read_own(self.authority_path)
        except FileNotFoundError:
            return None
        except _NotOwnFile as error:
            raise DamagedAuthority(str(error)) from error
        authority = certificate_authority.parse(data)
        if mode & 0o077 and notes is not None:
            self.authority_path.chmod(0o600)
            notes.append(
                f"until now, other users could read the key in {self.authority_path} (mode {mode:04o}); "
                f"if any may have, replace it: {NEXT_COMMAND} --new-authority"
            )
        return authority

    def _holds(self, path: Path, content: bytes) -> bool:
        try:
            return _read_own(path)[0] == content
        except (FileNotFoundError, _NotOwnFile):
            return False

    # -- the leaf -----------------------------------------------------------------------------------------------------
    def _load_leaf(self) -> tuple[Leaf | None, list[str]]:
        """Load the leaf; None, with notes on why, if it is missing or damaged or others may have read its key."""
        try:
            data, mode = _read_own(self.server_path)
        except FileNotFoundError:
            return None, []
        except _NotOwnFile as error:
            return None, [f"{self.server_path} was replaced: {error}"]
        if mode & 0o077:
            return None, [f"{self.server_path} was replaced: other users could read it (mode {mode:04o})"]
        found = leaf.parse(data)
        return found, [] if found else [f"{self.server_path} was damaged and was replaced"]

    # -- the folder ---------------------------------------------------------------------------------------------------
    def _check_owner(self) -> None:
        owner = self.folder.stat().st_uid
        if owner != os.geteuid():
            raise CertificateError(
                f"{self.folder} belongs to user {owner}, but this is user {os.geteuid()}; run Lupin as its owner, "
                f"without sudo, or take the folder over: sudo chown -R $USER {self.folder}"
            )

    @contextlib.contextmanager
    def _lock(self) -> Iterator[None]:
        make_state_folder(self.folder)
        self._check_owner()
        if self.folder.stat().st_mode & 0o077:
            self.folder.chmod(0o700)
        descriptor = os.open(self.folder / "lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
        try:
            deadline = time.monotonic() + LOCK_TIMEOUT_S
            while True:
                try:
                    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    break
                except BlockingIOError:
                    if time.monotonic() > deadline:
                        message = (
                            f"another process has used {self.folder} for {LOCK_TIMEOUT_S:g} s; see: fuser {self.folder}/lock"
                        )
                        raise CertificateError(message) from None
                    time.sleep(_LOCK_PERIOD_S)
            yield
        finally:
            os.close(descriptor)


class _NotOwnFile(ValueError):
    """A file that another user may have written; the message says why."""


def _read_own(path: Path) -> tuple[bytes, int]:
    """Read the content and permissions of a regular file of this user. Raises _NotOwnFile and OSError."""
    if path.is_symlink():
        raise _NotOwnFile("it is a symbolic link")
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK)
    with os.fdopen(descriptor, "rb") as file:
        found = os.fstat(descriptor)
        if not stat.S_ISREG(found.st_mode):
            raise _NotOwnFile("it is not a regular file")
        if found.st_uid != os.geteuid():
            raise _NotOwnFile(f"it belongs to user {found.st_uid}")
        return file.read(_MAX_BYTES), stat.S_IMODE(found.st_mode)


@contextlib.contextmanager
def _explained(folder: Path) -> Iterator[None]:
    """Turn errors of the file system into a CertificateError."""
    try:
        yield
    except OSError as error:
        problem = f"{error.strerror or error} ({error.filename or folder})"
        raise CertificateError(
            f"the console's certificate cannot be read or written: {problem}; "
            "free space, correct the permissions, or set XDG_STATE_HOME"
        ) from error
