"""Which host keys are accepted. A robot's key belongs to the robot, whichever of its addresses is used.

Every robot's access point has the address 192.168.42.1, and every cable 10.42.0.1: Lupin's own known_hosts therefore names keys
by robot. Where it has none for one, the user's known_hosts is asked by address.
"""

from __future__ import annotations

import base64
import contextlib
import hashlib
import hmac
import os
import shutil
import subprocess
import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from lupin_cli.target.base import HostKeyChanged, HostKeyUnknown
from lupin_cli.target.destination import Destination

if TYPE_CHECKING:
    import paramiko

Ask = Callable[[str], bool]  # shows a question to a person; True is yes

_lock = threading.Lock()  # many robots are reached at once: one question, one writer at a time


def fingerprint(key: paramiko.PKey) -> str:
    """The SHA256 fingerprint of a host key, as `ssh-keygen -l` prints it."""
    return "SHA256:" + base64.b64encode(hashlib.sha256(key.asbytes()).digest()).decode().rstrip("=")


class Trust:
    """The accepted keys. `ask` is None where nobody can be asked; `accept` is a fingerprint that a person gave beforehand."""

    def __init__(self, own: Path, users: Path | None = None, ask: Ask | None = None, accept: str = "") -> None:
        self._own, self._users = own, Path("~/.ssh/known_hosts").expanduser() if users is None else users
        self._ask, self._accept = ask, accept

    def known(self, name: str, destination: Destination) -> tuple[list[paramiko.PKey], Path]:
        """The keys accepted for the robot `name`, or by its address, and the file that says so."""
        own = _keys_of(name, self._own)
        return (own, self._own) if own else (_keys_of(destination.known_as, self._users), self._users)

    def check(self, name: str, destination: Destination, key: paramiko.PKey) -> None:
        """Raise HostKeyChanged or HostKeyUnknown unless `key` is accepted, or is now."""
        with _lock:
            keys, place = self.known(name, destination)
            if any(known == key for known in keys):
                return
            shown = f"{key.get_name()} {fingerprint(key)}"
            if keys:
                accepted = ", ".join(f"{known.get_name()} {fingerprint(known)}" for known in keys)
                raise HostKeyChanged(
                    f"{name} at {destination.known_as} shows another key than the one that was accepted: it shows {shown}, "
                    f"{place} has {accepted}. Either it was installed anew, or this is not {name}",
                    f"lupin robots forget {name}",
                )
            accepted_before = bool(self._accept) and self._accept == fingerprint(key)
            who = name if destination.known_as in name else f"{name} at {destination.known_as}"
            question = f"{who} is new here and shows the key\n  {shown}\nIs that its key?"
            if accepted_before or (self._ask is not None and not self._accept and self._ask(question)):
                self._remember(name, key)
                return
            found = f", not {self._accept}" if self._accept else " that nobody has accepted yet"
            raise HostKeyUnknown(
                f"{name} at {destination.known_as} shows the key {shown}{found}",
                f"lupin robots check {name} --accept {fingerprint(key)}",
            )

    def forget(self, name: str, destinations: list[Destination]) -> list[str]:
        """Drop every key of a robot, from Lupin's file and from the user's; returns where something was dropped."""
        dropped = []
        with _lock:
            if self._own.is_file():
                lines = self._own.read_text().splitlines(keepends=True)
                kept = [line for line in lines if line.split(" ", 1)[0] != name]
                if kept != lines:
                    _replace(self._own, "".join(kept))
                    dropped.append(f"{name} in {self._own}")
            for known_as in sorted({destination.known_as for destination in destinations}):
                if _keys_of(known_as, self._users) and shutil.which("ssh-keygen"):
                    # It knows hashed names, and leaves known_hosts.old behind.
                    command = ["ssh-keygen", "-q", "-R", known_as, "-f", str(self._users)]
                    if subprocess.run(command, capture_output=True, timeout=10).returncode == 0:
                        dropped.append(f"{known_as} in {self._users}")
        return dropped

    def _remember(self, name: str, key: paramiko.PKey) -> None:
        before = self._own.read_text() if self._own.is_file() else ""
        _replace(self._own, f"{before}{name} {key.get_name()} {key.get_base64()}\n")


def _keys_of(name: str, path: Path) -> list[paramiko.PKey]:
    """The keys that a known_hosts file has for `name`, the first of each type.

    `paramiko.HostKeys` makes keys of all lines, and ends at the first that is none: here each of the others is passed over.
    """
    if not path.is_file():
        return []
    from paramiko.hostkeys import HostKeyEntry, InvalidHostKey
    from paramiko.ssh_exception import SSHException

    found: dict[str, paramiko.PKey] = {}
    for fields in map(str.split, path.read_text(errors="replace").splitlines()):
        if fields and any(_means(pattern, name) for pattern in fields[0].split(",")):
            with contextlib.suppress(SSHException, InvalidHostKey):
                entry = HostKeyEntry.from_line(" ".join(fields))
                if entry is not None and entry.key is not None:
                    found.setdefault(entry.key.get_name(), entry.key)
    return list(found.values())


def _means(pattern: str, name: str) -> bool:
    """Whether a name of a known_hosts file, which may be hashed, is `name`."""
    if not pattern.startswith("|1|"):
        return pattern == name
    try:
        salt, digest = map(base64.b64decode, pattern.split("|")[2:])
    except ValueError:  # not two words of base64
        return False
    return hmac.compare_digest(hmac.digest(salt, name.encode(), "sha1"), digest)


def _replace(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    new = path.with_name(f"{path.name}.{os.getpid()}")
    new.write_text(text)
    new.chmod(0o600)
    new.replace(path)
