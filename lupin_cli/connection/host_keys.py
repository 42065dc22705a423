"""Which host keys are accepted. A robot's key belongs to the robot, whichever of its addresses is used.

The access point of every robot has the address 192.168.42.1, and every cable 10.42.0.1. Lupin's own known_hosts file therefore
stores keys by the robot's name. If it has none for a robot, the user's known_hosts file is searched by address.
"""

from __future__ import annotations

import base64
import contextlib
import hashlib
import hmac
import re
import shlex
import shutil
import subprocess
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from lupin_cli.connection.base import HostKeyChanged, HostKeyUnknown
from lupin_cli.connection.destination import Destination
from lupin_runtime.atomic_file import write_atomically
from lupin_runtime.bounded_file import is_file, read_bounded_text

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

    def key_types(self, name: str, destination: Destination) -> list[str]:
        """Return the types of the accepted keys, to ask the server for one of them."""
        return list(dict.fromkeys(key.get_name() for key in self._find(name, destination)[0].accepted))

    def _find(self, name: str, destination: Destination) -> tuple[_Entries, Path]:
        """Return what is known of the robot `name`, or else of its address, and the file that says it."""
        own = _entries_of(name, self._lupin_file)
        if own.accepted:
            return own, self._lupin_file
        return _entries_of(destination.known_as, self._user_file), self._user_file

    def verify(self, name: str, destination: Destination, key: paramiko.PKey) -> bool:
        """Raise HostKeyChanged or HostKeyUnknown unless `key` is accepted; return whether that was done just now.

        A key that either file revokes is refused, whatever else they say.
        """
        with _lock:
            entries, path = self._find(name, destination)
            accepted = entries.accepted
            shown = f"{key.get_name()} {fingerprint(key)}"
            for at, known_as in ((self._lupin_file, name), (self._user_file, destination.known_as)):
                if key in _entries_of(known_as, at).revoked:
                    raise HostKeyChanged(
                        f"{name} at {destination.known_as} shows {shown}, a key that {at} revokes: it may be in other hands",
                        f"ssh-keygen -l -F {shlex.quote(known_as)} -f {shlex.quote(str(at))}",
                    )
            if key in accepted:
                return False
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
                return True
            found = f", not {self._accept}" if self._accept else " that nobody has accepted yet"
            if entries.unreadable:
                found += f" ({', '.join(entries.unreadable)} cannot be read)"
            raise HostKeyUnknown(
                f"{name} at {destination.known_as} shows the key {shown}{found}",
                f"lupin robots check {name} --accept {fingerprint(key)}",
            )

    def forget(self, name: str, destinations: list[Destination]) -> list[str]:
        """Remove every key of a robot from Lupin's file and from the user's; return what was removed from which file."""
        removed = []
        with _lock:
            if lines := self._own_text().splitlines(keepends=True):
                kept = [line for line in lines if line.split(" ", 1)[0] != name]
                if kept != lines:
                    self._write("".join(kept))
                    removed.append(f"{name} in {self._lupin_file}")
            for known_as in sorted({destination.known_as for destination in destinations}):
                if _entries_of(known_as, self._user_file).accepted and shutil.which("ssh-keygen"):
                    # ssh-keygen also finds hashed names, and keeps a copy as known_hosts.old.
                    command = ["ssh-keygen", "-q", "-R", known_as, "-f", str(self._user_file)]
                    if subprocess.run(command, capture_output=True, timeout=10).returncode == 0:
                        removed.append(f"{known_as} in {self._user_file}")
        return removed

    def rename(self, old: str, new: str) -> bool:
        """Keep the accepted key of a robot under another name; return whether there was one in Lupin's file."""
        with _lock:
            lines = self._own_text().splitlines(keepends=True)
            renamed = [f"{new} {line.split(' ', 1)[1]}" if line.split(" ", 1)[0] == old else line for line in lines]
            if renamed != lines:
                self._write("".join(renamed))
            return renamed != lines

    def _own_text(self) -> str:
        """Return the text of Lupin's file, in which bytes that are not UTF-8 survive; empty if there is none."""
        return read_bounded_text(self._lupin_file, errors="surrogateescape") if is_file(self._lupin_file) else ""

    def _add(self, name: str, key: paramiko.PKey) -> None:
        before = self._own_text()
        self._write(f"{before}{name} {key.get_name()} {key.get_base64()}\n")

    def _write(self, text: str) -> None:
        self._lupin_file.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(self._lupin_file, text.encode("utf-8", "surrogateescape"), mode=0o600)


@dataclass(frozen=True)
class _Entries:
    """What a known_hosts file says of one name: accepted and revoked keys, and the lines on it that cannot be read."""

    accepted: list[paramiko.PKey] = field(default_factory=list)
    revoked: list[paramiko.PKey] = field(default_factory=list)
    unreadable: list[str] = field(default_factory=list)


def _entries_of(name: str, path: Path) -> _Entries:
    """Return what a known_hosts file, in the format of sshd(8), says of `name`.

    `paramiko.HostKeys` stops at the first unreadable line, knows no markers and patterns, and keeps one key of each type.
    """
    found = _Entries()
    if not path.is_file():
        return found
    for number, line in enumerate(read_bounded_text(path, errors="replace").splitlines(), 1):
        fields = line.split()
        if not fields or fields[0].startswith("#"):
            continue
        marker = fields.pop(0) if fields[0].startswith("@") else ""
        if not fields or not _names(fields[0], name) or marker == "@cert-authority":  # paramiko knows no certificates
            continue
        key = _read_key(fields[1:])
        if key is None or marker not in ("", "@revoked"):
            found.unreadable.append(f"{path}:{number}")
        else:
            (found.revoked if marker else found.accepted).append(key)
    return found


def _read_key(fields: list[str]) -> paramiko.PKey | None:
    from paramiko.hostkeys import HostKeyEntry, InvalidHostKey
    from paramiko.ssh_exception import SSHException

    with contextlib.suppress(SSHException, InvalidHostKey, ValueError):
        entry = HostKeyEntry.from_line(" ".join(["x", *fields]))
        return entry.key if entry is not None else None
    return None


def _names(patterns: str, name: str) -> bool:
    """Return whether the first field of a line, patterns or hashed names, stands for `name`. A pattern with ! excludes it."""
    included = False
    for pattern in patterns.split(","):
        if _matches(pattern.removeprefix("!"), name):
            if pattern.startswith("!"):
                return False
            included = True
    return included


def _matches(pattern: str, name: str) -> bool:
    if not pattern.startswith("|1|"):
        # fnmatch would also read [...], in which a name with a port stands.
        expression = re.escape(pattern.lower()).replace(r"\*", ".*").replace(r"\?", ".")
        return re.fullmatch(expression, name.lower()) is not None
    try:
        salt, digest = map(base64.b64decode, pattern.split("|")[2:])
    except ValueError:  # not two words of base64
        return False
    return hmac.compare_digest(hmac.digest(salt, name.encode(), "sha1"), digest)
