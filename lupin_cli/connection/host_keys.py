"""Which host keys are accepted. A robot's key belongs to the robot, whichever of its addresses is used.

The access point of every robot has the address 192.168.42.1, and every cable 10.42.0.1. Lupin's own known_hosts file therefore
stores keys by the robot's name. If it has none for a robot, the user's known_hosts file is searched by address.
"""

from __future__ import annotations

import base64
import contextlib
import hashlib
import hmac
import shutil
import subprocess
import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from lupin_cli.connection.base import HostKeyChanged, HostKeyUnknown
from lupin_cli.connection.destination import Destination
from lupin_runtime.atomic_file import write_atomically

if TYPE_CHECKING:
    import paramiko

Confirm = Callable[[str], bool]  # asks a person a yes-or-no question

_lock = threading.Lock()  # several robots are reached in parallel: one question and one writer at a time


def fingerprint(key: paramiko.PKey) -> str:
    """Return the SHA256 fingerprint of a host key, as `ssh-keygen -l` prints it."""
    return "SHA256:" + base64.b64encode(hashlib.sha256(key.asbytes()).digest()).decode().rstrip("=")


class KnownHosts:
    """The accepted host keys: those in Lupin's file, by the robot's name, and those in the user's, by address.

    `confirm` is None if nobody can be asked to accept a key; `accept` is the fingerprint of a key to accept without asking.
    """

    def __init__(
        self, lupin_file: Path, user_file: Path | None = None, confirm: Confirm | None = None, accept: str = ""
    ) -> None:
        self._lupin_file = lupin_file
        self._user_file = Path("~/.ssh/known_hosts").expanduser() if user_file is None else user_file
        self._confirm, self._accept = confirm, accept

    def accepted_keys(self, name: str, destination: Destination) -> tuple[list[paramiko.PKey], Path]:
        """Return the keys accepted for the robot `name`, or else for its address, and the file that holds them."""
        keys = _keys_of(name, self._lupin_file)
        return (keys, self._lupin_file) if keys else (_keys_of(destination.known_as, self._user_file), self._user_file)

    def verify(self, name: str, destination: Destination, key: paramiko.PKey) -> None:
        """Raise HostKeyChanged or HostKeyUnknown unless `key` is accepted, or a person accepts it now."""
        with _lock:
            accepted, path = self.accepted_keys(name, destination)
            if key in accepted:
                return
            shown = f"{key.get_name()} {fingerprint(key)}"
            if accepted:
                expected = ", ".join(f"{known.get_name()} {fingerprint(known)}" for known in accepted)
                raise HostKeyChanged(
                    f"{name} at {destination.known_as} shows a key other than the accepted one: it shows {shown}, "
                    f"{path} has {expected}. Either it was reinstalled, or this is not {name}",
                    f"lupin robots forget {name}",
                )
            preaccepted = bool(self._accept) and self._accept == fingerprint(key)
            label = name if destination.known_as in name else f"{name} at {destination.known_as}"
            question = f"{label} is not known yet and shows the key\n  {shown}\nIs that its key?"
            if preaccepted or (self._confirm is not None and not self._accept and self._confirm(question)):
                self._add(name, key)
                return
            found = f", not {self._accept}" if self._accept else " that nobody has accepted yet"
            raise HostKeyUnknown(
                f"{name} at {destination.known_as} shows the key {shown}{found}",
                f"lupin robots check {name} --accept {fingerprint(key)}",
            )

    def forget(self, name: str, destinations: list[Destination]) -> list[str]:
        """Remove every key of a robot from Lupin's file and from the user's; return what was removed from which file."""
        removed = []
        with _lock:
            if self._lupin_file.is_file():
                lines = self._lupin_file.read_text().splitlines(keepends=True)
                kept = [line for line in lines if line.split(" ", 1)[0] != name]
                if kept != lines:
                    self._write("".join(kept))
                    removed.append(f"{name} in {self._lupin_file}")
            for known_as in sorted({destination.known_as for destination in destinations}):
                if _keys_of(known_as, self._user_file) and shutil.which("ssh-keygen"):
                    # ssh-keygen also finds hashed names, and keeps a copy as known_hosts.old.
                    command = ["ssh-keygen", "-q", "-R", known_as, "-f", str(self._user_file)]
                    if subprocess.run(command, capture_output=True, timeout=10).returncode == 0:
                        removed.append(f"{known_as} in {self._user_file}")
        return removed

    def _add(self, name: str, key: paramiko.PKey) -> None:
        before = self._lupin_file.read_text() if self._lupin_file.is_file() else ""
        self._write(f"{before}{name} {key.get_name()} {key.get_base64()}\n")

    def _write(self, text: str) -> None:
        self._lupin_file.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(self._lupin_file, text, mode=0o600)


def _keys_of(name: str, path: Path) -> list[paramiko.PKey]:
    """Return the keys that a known_hosts file has for `name`, the first of each type.

    `paramiko.HostKeys` stops at the first unreadable line and decodes the keys of all names; this function does neither.
    """
    if not path.is_file():
        return []
    from paramiko.hostkeys import HostKeyEntry, InvalidHostKey
    from paramiko.ssh_exception import SSHException

    found: dict[str, paramiko.PKey] = {}
    for fields in map(str.split, path.read_text(errors="replace").splitlines()):
        if fields and any(_matches(pattern, name) for pattern in fields[0].split(",")):
            with contextlib.suppress(SSHException, InvalidHostKey):
                entry = HostKeyEntry.from_line(" ".join(fields))
                if entry is not None and entry.key is not None:
                    found.setdefault(entry.key.get_name(), entry.key)
    return list(found.values())


def _matches(pattern: str, name: str) -> bool:
    """Return whether an entry of a known_hosts file, which may be hashed, stands for `name`."""
    if not pattern.startswith("|1|"):
        return pattern == name
    try:
        salt, digest = map(base64.b64decode, pattern.split("|")[2:])
    except ValueError:  # not two words of base64
        return False
    return hmac.compare_digest(hmac.digest(salt, name.encode(), "sha1"), digest)
