"""A known_hosts file as OpenSSH reads it: see sshd(8), SSH_KNOWN_HOSTS FILE FORMAT, and hostfile.c."""

from __future__ import annotations

import base64
import hashlib
import hmac
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from lupin_cli.connection.ssh_config_words import matches_list
from lupin_runtime.bounded_file import is_file, read_bounded

_SIGNATURES_OF_RSA = ("rsa-sha2-256", "rsa-sha2-512")  # also names of the type of an RSA key
_SALT_BYTES = 20


@dataclass(frozen=True)
class HostKey:
    """A public key: its type, and its bytes in the format of RFC 4253."""

    type: str
    blob: bytes

    @property
    def base64(self) -> str:
        """The bytes as known_hosts has them."""
        return base64.b64encode(self.blob).decode()

    @property
    def fingerprint(self) -> str:
        """The SHA256 fingerprint, as `ssh-keygen -l` prints it."""
        return "SHA256:" + base64.b64encode(hashlib.sha256(self.blob).digest()).decode().rstrip("=")

    def __str__(self) -> str:
        return f"{self.type} {self.fingerprint}"


@dataclass(frozen=True)
class Entry:
    """A key and the line that has it, as FILE:LINE."""

    key: HostKey
    place: str


@dataclass(frozen=True)
class Entries:
    """What known_hosts files say of one name: its keys by their marker, and the lines on it that cannot be read."""

    accepted: list[Entry] = field(default_factory=list)
    revoked: list[Entry] = field(default_factory=list)
    authorities: list[Entry] = field(default_factory=list)  # that sign host certificates
    unreadable: list[str] = field(default_factory=list)


def entries_of(name: str, paths: Iterable[Path]) -> Entries:
    """Return what the files say of `name`. One that is missing, is no file or cannot be opened says nothing, as for ssh."""
    found = Entries()
    by_marker = {"": found.accepted, "@revoked": found.revoked, "@cert-authority": found.authorities}
    for path in paths:
        if not is_file(path):
            continue
        try:
            text = read_bounded(path).decode("utf-8", "surrogateescape")
        except OSError as error:
            found.unreadable.append(f"{path} ({error.strerror})")
            continue
        for number, line in enumerate(text.split("\n"), 1):
            line = line.partition("\0")[0].lstrip(" \t")
            if not line or line.startswith("#"):
                continue
            fields = re.split(r"[ \t]+", line)
            marker = fields.pop(0) if fields[0].startswith("@") else ""
            if not fields or not _stands_for(fields[0], name):
                continue
            key = _read_key(fields[1:])
            if key is None or marker not in by_marker:
                found.unreadable.append(f"{path}:{number}")
            else:
                by_marker[marker].append(Entry(key, f"{path}:{number}"))
    return found


def keys_of(content: bytes) -> list[HostKey]:
    """Return the public keys of a file that has one a line, as RevokedHostKeys names it. Raises OSError for another line."""
    keys = []
    for number, line in enumerate(content.decode("utf-8", "surrogateescape").split("\n"), 1):
        if (line := line.strip(" \t\r")) and not line.startswith("#"):
            if (key := _read_key(re.split(r"[ \t]+", line))) is None:
                raise OSError(f"line {number} is no public key")
            keys.append(key)
    return keys


def _stands_for(patterns: str, name: str) -> bool:
    """Return whether the first field of a line, patterns or one hashed name, stands for `name`."""
    if not patterns.startswith("|"):
        return matches_list(patterns, name.lower(), lower=True)
    try:
        _, version, salt, digest = patterns.split("|")
        decoded = base64.b64decode(salt, validate=True)
        expected = base64.b64encode(hmac.digest(decoded, name.encode("utf-8", "surrogateescape"), "sha1")).decode()
    except ValueError:  # other parts, or not base64
        return False
    return version == "1" and len(decoded) == _SALT_BYTES and expected == digest


def _read_key(fields: list[str]) -> HostKey | None:
    if len(fields) < 2 or fields[0].startswith("#"):
        return None
    key_type = "ssh-rsa" if fields[0] in _SIGNATURES_OF_RSA else fields[0]
    try:
        blob = base64.b64decode(fields[1].strip("\r"), validate=True)
    except ValueError:
        return None
    return HostKey(key_type, blob) if _is_valid(key_type, blob) else None


def _is_valid(key_type: str, blob: bytes) -> bool:
    """Return whether the bytes are those of a public key of this type."""
    import paramiko

    encoded = key_type.encode("utf-8", "surrogateescape")
    if not blob.startswith(len(encoded).to_bytes(4, "big") + encoded):
        return False
    if key_type.startswith(("sk-", "ssh-dss")) or "-cert-v0" in key_type:  # ssh knows them, paramiko does not
        return True
    try:
        return paramiko.PKey.from_type_string(key_type, blob).asbytes() == blob
    except (paramiko.SSHException, ValueError, IndexError, TypeError):
        return False
