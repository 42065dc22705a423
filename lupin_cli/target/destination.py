"""Where a connection goes: what the inventory says, filled up from ~/.ssh/config."""

from __future__ import annotations

import functools
import getpass
import glob
import re
import threading
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import TargetError

if TYPE_CHECKING:
    import paramiko

_reading = threading.Lock()  # whoever sets out for many robots at once reads the file once
_INCLUDE = re.compile(r"^\s*include[\s=]+(.+?)\s*$", re.IGNORECASE)
_WHERE = re.compile(r"\s*(hostname|port|user|proxyjump|proxycommand|match|canonical\w*)\b", re.IGNORECASE)
_INCLUDE_DEPTH = 8  # OpenSSH stops at 16; a file that includes itself must end somewhere
_DESTINATION = re.compile(
    r"^(?:(?P<user>[^@\s]+)@)?(?P<host>\[[0-9A-Fa-f:.]+(?:%[^\]\s]+)?\]|[^@:\s]+)(?::(?P<port>\d{1,5}))?$"
)


@dataclass(frozen=True)
class Destination:
    """Everything needed to reach an sshd, with nothing left to look up but the host's address."""

    host: str
    port: int = 22
    user: str = ""
    identity_files: tuple[str, ...] = ()
    identities_only: bool = False
    jumps: tuple[Destination, ...] = ()  # in the order they are passed
    proxy_command: str = ""
    asked: str = ""  # the host as it was asked for, before ~/.ssh/config named another

    def __str__(self) -> str:
        return f"{self.user}@{self.host}" + (f":{self.port}" if self.port != 22 else "")

    @property
    def known_as(self) -> str:
        """How known_hosts files name it."""
        return self.host if self.port == 22 else f"[{self.host}]:{self.port}"


def parse_destination(text: str) -> tuple[str, str, int]:
    """`[user@]host[:port]` as user (or ""), host and port (or 0). Raises ValueError."""
    found = _DESTINATION.match(text)
    if found is None or int(found["port"] or 1) not in range(1, 65536):
        raise ValueError(f"{text!r} is no [user@]host[:port]")
    return found["user"] or "", found["host"].strip("[]"), int(found["port"] or 0)


def resolve(
    host: str, user: str = "", port: int = 0, *, default_user: str = "", config_path: Path | None = None
) -> Destination:
    """The destination for `host`, which may be an alias of ~/.ssh/config; `user` and `port` win over that file.

    `default_user` is for where neither says one; else it is the name of whoever runs this.

    Raises TargetError where the file can't be read.
    """
    path, lines = _users_config(config_path)
    if lines:
        with _reading:
            config = _ssh_config(path, "\n".join(lines))
        found = _resolve(config, host, user, port, ())
    else:  # nothing to look up, for which paramiko would be imported
        found = Destination(host, port or 22, user, asked=host)
    return found if found.user else replace(found, user=default_user or getpass.getuser())


def located(host: str, user: str = "", port: int = 0, *, config_path: Path | None = None) -> Destination | None:
    """Where `resolve` finds `host`, told without paramiko, which takes its time to be imported; None where ~/.ssh/config may
    have a say in it. Raises TargetError where that can't be read."""
    _, lines = _users_config(config_path)
    return None if any(map(_WHERE.match, lines)) else Destination(host, port or 22, user, asked=host)


def _users_config(config_path: Path | None) -> tuple[Path, list[str]]:
    """~/.ssh/config unless another is named, and its lines. Raises TargetError."""
    path = Path("~/.ssh/config").expanduser() if config_path is None else config_path
    try:
        return path, _lines(path, 0)
    except OSError as error:
        raise _unreadable(path, error) from error


def _resolve(config: paramiko.SSHConfig, host: str, user: str, port: int, passed: tuple[str, ...]) -> Destination:
    import paramiko

    try:
        entry = config.lookup(host)
        port = port or int(entry.get("port", 22))
    except (paramiko.SSHException, ImportError, ValueError) as error:  # Match exec, CanonicalizeHostname, a bad port
        raise TargetError(f"~/.ssh/config says of {host} what can't be followed: {error}", f"ssh -G {host}") from error
    jumps: tuple[Destination, ...] = ()
    jump = entry.get("proxyjump", "none")
    if jump.lower() != "none":
        if host in passed:
            raise TargetError(f"~/.ssh/config jumps in a circle: {' -> '.join([*passed, host])}", f"ssh -G {host}")
        for hop in jump.split(","):
            try:
                hop_user, hop_host, hop_port = parse_destination(hop.strip().removeprefix("ssh://"))
            except ValueError as error:
                raise TargetError(f"~/.ssh/config jumps for {host}: {error}", f"ssh -G {host}") from error
            found = _resolve(config, hop_host, hop_user, hop_port, (*passed, host))
            jumps += (*found.jumps, found if found.user else replace(found, user=getpass.getuser()))
    proxy_command = entry.get("proxycommand", "none")
    return Destination(
        host=entry.get("hostname", host),
        port=port,
        user=user or entry.get("user", ""),
        identity_files=tuple(str(Path(name).expanduser()) for name in entry.get("identityfile", ())),
        identities_only=entry.get("identitiesonly", "no").lower() == "yes",
        jumps=jumps,
        proxy_command="" if jumps or proxy_command.lower() == "none" else proxy_command,
        asked=host,
    )


@functools.lru_cache(maxsize=1)
def _ssh_config(path: Path, text: str) -> paramiko.SSHConfig:
    import paramiko

    try:
        return paramiko.SSHConfig.from_text(text)
    except paramiko.SSHException as error:
        raise _unreadable(path, error) from error


def _unreadable(path: Path, error: Exception) -> TargetError:
    return TargetError(f"{path} can't be read: {error}", f"ssh -F {path} -G localhost")


def _lines(path: Path, depth: int) -> list[str]:
    """The lines of an ssh_config with its includes in their places: paramiko passes over Include."""
    try:
        text = path.read_text(errors="replace")
    except FileNotFoundError:
        return []
    lines: list[str] = []
    for line in text.splitlines():
        found = _INCLUDE.match(line)
        if found is None:
            lines.append(line)
        elif depth < _INCLUDE_DEPTH:
            for pattern in found[1].split():
                pattern = pattern.strip('"')
                place = Path(pattern).expanduser() if pattern.startswith("~") else path.parent / pattern
                for name in sorted(glob.glob(str(place))):  # noqa: PTH207 - the pattern is absolute
                    lines += _lines(Path(name), depth + 1)
    return lines
