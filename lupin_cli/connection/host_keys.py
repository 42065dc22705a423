"""Which host keys are accepted. A robot's key belongs to the robot, whichever of its addresses is used.

The access point of every robot has the address 192.168.42.1, and every cable 10.42.0.1. Lupin's own known_hosts file therefore
stores keys by the robot's name. If it has none for a robot, the files that ssh reads decide, by address or HostKeyAlias, as
they do for ssh (sshd(8), SSH_KNOWN_HOSTS FILE FORMAT). A key that any of them revokes is refused in any case.
"""

from __future__ import annotations

import enum
import itertools
import shlex
import shutil
import subprocess
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from lupin_cli.connection.base import HostKeyChanged, HostKeyUnknown
from lupin_cli.connection.destination import Destination
from lupin_cli.connection.known_hosts_file import Entries, HostKey, entries_of, keys_of
from lupin_runtime.atomic_file import write_atomically
from lupin_runtime.bounded_file import is_file, read_bounded, read_bounded_text

if TYPE_CHECKING:
    import paramiko

_KRL = b"SSHKRL\n\0"  # how a key revocation list begins

Confirm = Callable[[str], bool]  # asks a person a yes-or-no question

_lock = threading.Lock()  # several robots are reached in parallel: one question and one writer at a time


class Status(enum.Enum):
    """What the files say of a key, in OpenSSH's words."""

    NEW = "no key of this host is known"
    OK = "the key is known"
    CHANGED = "other keys are known"
    REVOKED = "the key is revoked"


class KnownHosts:
    """The accepted host keys: those in Lupin's file, by the robot's name, and those in the files of ssh, by address.

    `user_file` replaces the files that a destination names. `confirm` is None if nobody can be asked to accept a key; `accept`
    is the fingerprint of a key to accept without asking.
    """

    def __init__(
        self, lupin_file: Path, user_file: Path | None = None, confirm: Confirm | None = None, accept: str = ""
    ) -> None:
        self._lupin_file, self._user_file = lupin_file, user_file
        self._confirm, self._accept = confirm, accept

    def key_types(self, name: str, destination: Destination) -> list[str]:
        """Return the types of the accepted keys, to ask the server for one of them."""
        own, ported, portless = self._own_entries(name), self._ported(destination), self._portless(destination)
        found = own.accepted or ported.accepted or portless.accepted
        return list(dict.fromkeys(entry.key.type for entry in found))

    def status(self, destination: Destination, key: HostKey) -> Status:
        """Return what the files of ssh say of a key: where they know none of its port, a line without a port may accept it."""
        status = _status(self._ported(destination), key)
        portless = _status(self._portless(destination), key)
        return portless if status is Status.NEW and portless in (Status.OK, Status.REVOKED) else status

    def _files(self, destination: Destination) -> tuple[list[Path], list[Path]]:
        """Return the files of the user and those of the system."""
        if self._user_file is not None:
            return [self._user_file], []
        users = destination.user_known_hosts
        if not users and not destination.global_known_hosts and not destination.original_host:  # not from a configuration
            users = ("~/.ssh/known_hosts",)
        return [Path(each).expanduser() for each in users], [Path(each) for each in destination.global_known_hosts]

    def _own_entries(self, name: str) -> Entries:
        return entries_of(name, [self._lupin_file])

    def _ported(self, destination: Destination) -> Entries:
        return entries_of(destination.known_as, itertools.chain(*self._files(destination)))

    def _portless(self, destination: Destination) -> Entries:
        if destination.port == 22 or destination.host_key_alias:
            return Entries()
        return entries_of(destination.host, itertools.chain(*self._files(destination)))

    def verify(self, name: str, destination: Destination, key: paramiko.PKey) -> bool:
        """Raise HostKeyChanged or HostKeyUnknown unless `key` is accepted; return whether that was done just now.

        A key that any file revokes is refused, whatever else they say.
        """
        with _lock:
            return self._verify(name, destination, HostKey(key.get_name(), key.asbytes()))

    def _verify(self, name: str, destination: Destination, key: HostKey) -> bool:
        shown = f"{name} at {destination.known_as} shows {key}"
        own, ported, portless = self._own_entries(name), self._ported(destination), self._portless(destination)
        for entries, known_as in ((own, name), (ported, destination.known_as), (portless, destination.host)):
            for entry in entries.revoked:
                if entry.key == key:
                    file = entry.place.rpartition(":")[0]
                    raise HostKeyChanged(
                        f"{shown}, a key that {entry.place} revokes: it may be in other hands",
                        f"ssh-keygen -l -F {shlex.quote(known_as)} -f {shlex.quote(file)}",
                    )
        if destination.revoked_host_keys:
            _require_not_revoked(shown, key, Path(destination.revoked_host_keys))
        status = _status(own, key) if own.accepted else self.status(destination, key)
        if status is Status.OK:
            return False
        if status is Status.CHANGED:
            entries = own if own.accepted else ported
            expected = ", ".join(dict.fromkeys(f"{entry.key} in {entry.place}" for entry in entries.accepted))
            raise HostKeyChanged(
                f"{name} at {destination.known_as} shows a key other than the accepted one: it shows {key}, not {expected}. "
                f"Either it was reinstalled, or this is not {name}",
                self._forget_command(name, destination, entries),
            )
        preaccepted = bool(self._accept) and self._accept == key.fingerprint
        label = name if destination.known_as in name else f"{name} at {destination.known_as}"
        question = f"{label} is not known yet and shows the key\n  {key}\nIs that its key?"
        may_ask = self._confirm is not None and not self._accept and destination.asks_for_host_keys
        if preaccepted or (may_ask and self._confirm is not None and self._confirm(question)):
            self._add(name, key)
            return True
        found = f", not {self._accept}" if self._accept else ", which was not accepted yet"
        if authorities := [entry.place for entry in (*ported.authorities, *portless.authorities)]:
            found += f"; {', '.join(authorities)} trusts an authority's host certificates, which Lupin cannot verify"
        if unreadable := [*own.unreadable, *ported.unreadable, *portless.unreadable]:
            found += f" ({', '.join(unreadable)} cannot be read)"
        raise HostKeyUnknown(
            f"{name} at {destination.known_as} shows the key {key}{found}",
            f"lupin robots check {name} --accept {key.fingerprint}",
        )

    def _forget_command(self, name: str, destination: Destination, entries: Entries) -> str:
        """Return what removes the accepted keys; those in a file of the system, the administrator removes."""
        for path in self._files(destination)[1]:
            if any(entry.place.startswith(f"{path}:") for entry in entries.accepted):
                return f"sudo ssh-keygen -R {shlex.quote(destination.known_as)} -f {shlex.quote(str(path))}"
        return f"lupin robots forget {name}"

    def forget(self, name: str, destinations: list[Destination]) -> list[str]:
        """Remove every key of a robot from Lupin's file and from the user's; return what was removed from which file."""
        removed = []
        with _lock:
            if lines := self._own_text().splitlines(keepends=True):
                kept = [line for line in lines if line.split(" ", 1)[0] != name]
                if kept != lines:
                    self._write("".join(kept))
                    removed.append(f"{name} in {self._lupin_file}")
            places = {(each.known_as, path) for each in destinations for path in self._files(each)[0]}
            for known_as, path in sorted(places):
                before = len(entries_of(known_as, [path]).accepted)
                if before and shutil.which("ssh-keygen"):
                    # ssh-keygen also finds hashed names, and keeps a copy as known_hosts.old. It leaves patterns alone.
                    command = ["ssh-keygen", "-q", "-R", known_as, "-f", str(path)]
                    subprocess.run(command, capture_output=True, timeout=10, check=False)
                    if len(entries_of(known_as, [path]).accepted) < before:
                        removed.append(f"{known_as} in {path}")
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

    def _add(self, name: str, key: HostKey) -> None:
        self._write(f"{self._own_text()}{name} {key.type} {key.base64}\n")

    def _write(self, text: str) -> None:
        self._lupin_file.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(self._lupin_file, text.encode("utf-8", "surrogateescape"), mode=0o600)


def _status(entries: Entries, key: HostKey) -> Status:
    if any(entry.key == key for entry in entries.revoked):
        return Status.REVOKED
    if any(entry.key == key for entry in entries.accepted):
        return Status.OK
    return Status.CHANGED if entries.accepted else Status.NEW


def _require_not_revoked(shown: str, key: HostKey, path: Path) -> None:
    """Raise HostKeyChanged if the file of RevokedHostKeys, a list of keys or a KRL, has the key, or cannot be read."""
    try:
        content = read_bounded(path)
        is_revoked = _is_in_krl(key, path) if content.startswith(_KRL) else key in keys_of(content)
    except (OSError, subprocess.SubprocessError) as error:
        problem = f"{shown}, which cannot be compared with {path}, RevokedHostKeys: {error}"
        raise HostKeyChanged(problem, f"ls -l {shlex.quote(str(path))}") from error
    if is_revoked:
        raise HostKeyChanged(
            f"{shown}, a key that {path}, RevokedHostKeys, revokes: it may be in other hands", f"ls -l {shlex.quote(str(path))}"
        )


def _is_in_krl(key: HostKey, path: Path) -> bool:
    """Ask ssh-keygen, which reads key revocation lists. Raises OSError and SubprocessError."""
    with tempfile.NamedTemporaryFile("w", suffix=".pub") as public:
        public.write(f"{key.type} {key.base64}\n")
        public.flush()
        command = ["ssh-keygen", "-Q", "-f", str(path), public.name]
        done = subprocess.run(command, capture_output=True, text=True, timeout=10, stdin=subprocess.DEVNULL, check=False)
    if done.returncode != 0 and "REVOKED" not in done.stdout:
        raise OSError(done.stderr.strip())
    return done.returncode != 0
