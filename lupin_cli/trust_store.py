"""The system's store of trusted authorities, and what to do on systems where only a person can change it."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from lupin_runtime.atomic_file import write_atomically
from lupin_runtime.bounded_file import read_bounded

TIMEOUT_S = 180.0  # hooks of the program may rebuild Java's store
_SBIN = "/usr/local/sbin:/usr/sbin:/sbin"  # may be missing from a user's PATH


class TrustStoreError(RuntimeError):
    """The store could not be changed, and is as before; the message says why."""


@dataclass(frozen=True)
class TrustStore:
    """A folder of certificates, and the program that makes them effective after a change."""

    system: str
    folder: Path
    program: str
    options: tuple[str, ...] = ()
    removal_options: tuple[str, ...] = ()

    def path(self, authority_id: str) -> Path:
        """Return the file of an authority in the folder."""
        return self.folder / f"lupin-{authority_id}.crt"

    def holds(self, authority_id: str, certificate: bytes) -> bool:
        """Return whether the store has this certificate."""
        try:
            return read_bounded(self.path(authority_id)) == certificate
        except OSError:
            return False

    def is_writable(self) -> bool:
        """Return whether this user may change it."""
        return os.access(self.folder, os.W_OK)

    def add(self, authority_id: str, certificate: bytes) -> None:
        """Make the system trust a certificate in PEM. Raises TrustStoreError."""
        path = self.path(authority_id)
        try:
            write_atomically(path, certificate, mode=0o644)
        except OSError as error:
            raise TrustStoreError(f"{path} cannot be written: {error.strerror or error}") from error
        try:
            self._run(self.options)
        except TrustStoreError:
            path.unlink(missing_ok=True)
            raise

    def remove(self, authority_id: str) -> None:
        """Make the system forget an authority. Raises TrustStoreError."""
        path = self.path(authority_id)
        try:
            certificate = read_bounded(path)
            path.unlink()
        except OSError as error:
            raise TrustStoreError(f"{path} cannot be removed: {error.strerror or error}") from error
        try:
            self._run((*self.options, *self.removal_options))
        except TrustStoreError:
            write_atomically(path, certificate, mode=0o644)
            raise

    def add_command(self, authority_id: str, source: Path | str) -> str:
        """Return the command by which root does the same as `add`, with the certificate in the file `source`."""
        copy = shlex.join(("sudo", "install", "-m", "644", str(source), str(self.path(authority_id))))
        return f"{copy} && {shlex.join(('sudo', self.program, *self.options))}"

    def remove_command(self, authority_id: str) -> str:
        """Return the command by which root does the same as `remove`."""
        remove = shlex.join(("sudo", "rm", "-f", str(self.path(authority_id))))
        return f"{remove} && {shlex.join(('sudo', self.program, *self.options, *self.removal_options))}"

    def _run(self, options: Iterable[str]) -> None:
        program = _find_program(self.program)
        if program is None:
            raise TrustStoreError(f"{self.program} is not installed")
        try:
            done = subprocess.run([program, *options], capture_output=True, text=True, errors="replace", timeout=TIMEOUT_S)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise TrustStoreError(f"{self.program}: {error}") from error
        if done.returncode != 0:
            last = (done.stderr.strip() or done.stdout.strip()).splitlines()[-1:]
            raise TrustStoreError(f"{self.program} exited with {done.returncode}: {''.join(last) or 'it printed nothing'}")


DEBIAN = TrustStore(
    "Debian, Ubuntu", Path("/usr/local/share/ca-certificates"), "update-ca-certificates", removal_options=("--fresh",)
)
FEDORA = TrustStore("Fedora, RHEL", Path("/etc/pki/ca-trust/source/anchors"), "update-ca-trust")
TRUST_STORES = (
    DEBIAN,
    FEDORA,
    TrustStore("openSUSE", Path("/etc/pki/trust/anchors"), "update-ca-certificates"),
    TrustStore("Arch Linux", Path("/etc/ca-certificates/trust-source/anchors"), "update-ca-trust"),
)


def find_trust_store() -> TrustStore | None:
    """Return the store of this system; None if Lupin cannot change it."""
    return next((store for store in TRUST_STORES if store.folder.is_dir() and _find_program(store.program)), None)


def _find_program(name: str) -> str | None:
    return shutil.which(name, path=f"{os.environ.get('PATH', '')}:{_SBIN}")


def instructions(authority_id: str, file: str) -> list[tuple[str, str]]:
    """Return each system, and how to make it trust the authority whose certificate is in `file` there."""
    name, quoted = f"lupin-{authority_id}", shlex.quote(file)
    nss = f"certutil -d sql:$HOME/.pki/nssdb -A -t C,, -n {name} -i {quoted}"
    firefox = "Settings, Privacy & Security, View Certificates, Authorities, Import; tick 'Trust this CA to identify websites'"
    macos = f"sudo security add-trusted-cert -d -r trustRoot -k /Library/Keychains/System.keychain {quoted}"
    android = (
        "Settings, Security & privacy, More security settings, Encryption & credentials, Install a certificate, CA certificate"
    )
    ios = "open the file; Settings, Profile Downloaded, Install; General, About, Certificate Trust Settings: switch it on"
    return [
        *((store.system, store.add_command(authority_id, file)) for store in (DEBIAN, FEDORA)),
        ("Chrome and Chromium on Linux, which have their own store (libnss3-tools or nss-tools)", nss),
        ("Firefox on Linux, which has its own store", firefox),
        ("macOS", macos),
        ("Windows, in an administrator's terminal", f"certutil -addstore -f Root {quoted}"),
        ("Android", android),
        ("iOS, iPadOS", ios),
    ]
