"""Where a connection goes: an address of the inventory, completed by ~/.ssh/config."""

from __future__ import annotations

import functools
import getpass
import glob
import re
import threading
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from lupin_cli.connection.base import TargetError

if TYPE_CHECKING:
    import paramiko

_parse_lock = threading.Lock()  # threads that connect to several robots parse the file once
_INCLUDE = re.compile(r"^\s*include[\s=]+(.+?)\s*$", re.IGNORECASE)
_INCLUDE_DEPTH = 8  # OpenSSH stops at 16; a limit stops a file that includes itself
_DESTINATION = re.compile(
    r"^(?:(?P<user>[^@\s]+)@)?(?P<host>\[[0-9A-Fa-f:.]+(?:%[^\]\s]+)?\]|[^@:\s]+)(?::(?P<port>\d{1,5}))?$"
)


@dataclass(frozen=True)
class Destination:
    """Everything needed to connect to an sshd; only the host name is still to be resolved."""

    host: str
    port: int = 22
    user: str = ""
    identity_files: tuple[str, ...] = ()
    identities_only: bool = False
    jumps: tuple[Destination, ...] = ()  # in the order in which they are passed
    proxy_command: str = ""
    original_host: str = ""  # as the inventory or a command line names it, before ~/.ssh/config replaced it

    def __str__(self) -> str:
        return f"{self.user}@{self.host}" + (f":{self.port}" if self.port != 22 else "")

    @property
    def known_as(self) -> str:
        """The name under which a known_hosts file stores its key."""
        return self.host if self.port == 22 else f"[{self.host}]:{self.port}"


def parse_destination(text: str) -> tuple[str, str, int]:
    """Split `[user@]host[:port]` into user (or ""), host and port (or 0). Raises ValueError."""
    found = _DESTINATION.match(text)
    if found is None or int(found["port"] or 1) not in range(1, 65536):
        raise ValueError(f"expected [user@]host[:port], found {text!r}")
    return found["user"] or "", found["host"].strip("[]"), int(found["port"] or 0)


def resolve(
    host: str, user: str = "", port: int = 0, *, default_user: str = "", config_path: Path | None = None
) -> Destination:
    """Return the destination for `host`, which may be an alias of ~/.ssh/config. `user` and `port` override that file.

    If neither names a user, it is `default_user`, or else the user who runs Lupin. Raises TargetError for a file that
    cannot be read or applied.
    """
    path = Path("~/.ssh/config").expanduser() if config_path is None else config_path
    try:
        lines = _lines(path, 0)
    except OSError as error:
        raise _unreadable(path, error) from error
    with _parse_lock:
        config = _ssh_config(path, "\n".join(lines))
    found = _look_up(config, host, user, port, ())
    return found if found.user else replace(found, user=default_user or getpass.getuser())


def _look_up(config: paramiko.SSHConfig, host: str, user: str, port: int, jumping_from: tuple[str, ...]) -> Destination:
    import paramiko

    try:
        entry = config.lookup(host)
        port = port or int(entry.get("port", 22))
    except (paramiko.SSHException, ImportError, ValueError) as error:  # Match exec, CanonicalizeHostname, a bad port
        raise TargetError(f"~/.ssh/config cannot be applied to {host}: {error}", f"ssh -G {host}") from error
    jumps: tuple[Destination, ...] = ()
    jump = entry.get("proxyjump", "none")
    if jump.lower() != "none":
        if host in jumping_from:
            raise TargetError(f"~/.ssh/config jumps in a circle: {' -> '.join([*jumping_from, host])}", f"ssh -G {host}")
        for hop in jump.split(","):
            try:
                hop_user, hop_host, hop_port = parse_destination(hop.strip().removeprefix("ssh://"))
            except ValueError as error:
                raise TargetError(f"~/.ssh/config has a bad ProxyJump for {host}: {error}", f"ssh -G {host}") from error
            found = _look_up(config, hop_host, hop_user, hop_port, (*jumping_from, host))
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
        original_host=host,
    )


@functools.lru_cache(maxsize=1)
def _ssh_config(path: Path, text: str) -> paramiko.SSHConfig:
    import paramiko

    try:
        return paramiko.SSHConfig.from_text(text)
    except paramiko.SSHException as error:
        raise _unreadable(path, error) from error


def _unreadable(path: Path, error: Exception) -> TargetError:
    return TargetError(f"{path} cannot be read: {error}", f"ssh -F {path} -G localhost")


def _lines(path: Path, depth: int) -> list[str]:
    """Return the lines of an ssh_config with its includes inserted, because paramiko ignores Include."""
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
                included = Path(pattern).expanduser() if pattern.startswith("~") else path.parent / pattern
                for name in sorted(glob.glob(str(included))):  # noqa: PTH207 - the pattern is absolute
                    lines += _lines(Path(name), depth + 1)
    return lines
