"""Where a connection goes: an address of the inventory, completed by ~/.ssh/config."""

from __future__ import annotations

import contextlib
import errno
import functools
import getpass
import glob
import re
import threading
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from lupin_cli.connection.base import SshConfigUnusable
from lupin_cli.printed_commands import ssh
from lupin_runtime.bounded_file import expand_home, read_bounded_text

if TYPE_CHECKING:
    import paramiko

_parse_lock = threading.Lock()  # threads that connect to several robots parse the file once
_INCLUDE = re.compile(r"^\s*include[\s=]+(.+?)\s*$", re.IGNORECASE)
MAX_CONFIG_LINES = 20_000  # with all includes, which may multiply
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
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.user}@{host}" + (f":{self.port}" if self.port != 22 else "")

    @property
    def login_command(self) -> str:
        """What a person types to log in there; ~/.ssh/config adds what it says about the host, such as jump hosts."""
        return ssh(self.user, self.original_host or self.host, self.port)

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

    If neither names a user, it is `default_user`, or else the user who runs Lupin. Raises SshConfigUnusable for a file that
    cannot be read or applied.
    """
    path = Path("~/.ssh/config").expanduser() if config_path is None else config_path
    try:
        lines: list[str] = []
        _add_lines(path, 0, lines)
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
    except (
        paramiko.SSHException,
        ImportError,
        ValueError,
        LookupError,
        OSError,
    ) as error:  # Match exec, CanonicalizeHostname, a bad port
        raise SshConfigUnusable(f"~/.ssh/config cannot be applied to {host}: {error}", f"ssh -G {host}") from error
    jumps: tuple[Destination, ...] = ()
    jump = entry.get("proxyjump", "none")
    if jump.lower() != "none":
        if host in jumping_from:
            raise SshConfigUnusable(f"~/.ssh/config jumps in a circle: {' -> '.join([*jumping_from, host])}", f"ssh -G {host}")
        for hop in jump.split(","):
            try:
                hop_user, hop_host, hop_port = parse_destination(hop.strip().removeprefix("ssh://"))
            except ValueError as error:
                raise SshConfigUnusable(f"~/.ssh/config has a bad ProxyJump for {host}: {error}", f"ssh -G {host}") from error
            found = _look_up(config, hop_host, hop_user, hop_port, (*jumping_from, host))
            jumps += (*found.jumps, found if found.user else replace(found, user=getpass.getuser()))
    proxy_command = entry.get("proxycommand") or "none"  # paramiko gives None for "ProxyCommand none"
    return Destination(
        host=entry.get("hostname", host),
        port=port,
        user=user or entry.get("user", ""),
        identity_files=tuple(str(expand_home(name)) for name in entry.get("identityfile", ())),
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
    except (paramiko.SSHException, ValueError, LookupError) as error:  # its parser raises the latter for quotes and words
        raise _unreadable(path, error) from error


def _unreadable(path: Path, error: Exception) -> SshConfigUnusable:
    return SshConfigUnusable(f"{path} cannot be read: {error}", f"ssh -F {path} -G localhost")


def _add_lines(path: Path, depth: int, lines: list[str]) -> None:
    """Add the lines of an ssh_config with its includes inserted, because paramiko ignores Include. Raises OSError."""
    try:
        text = read_bounded_text(path, errors="replace")
    except FileNotFoundError:
        return
    for line in text.splitlines():
        found = _INCLUDE.match(line)
        if found is None:
            if len(lines) >= MAX_CONFIG_LINES:
                raise OSError(errno.EFBIG, f"has more than {MAX_CONFIG_LINES} lines with its includes", str(path))
            lines.append(line)
        elif depth < _INCLUDE_DEPTH:
            for pattern in found[1].split():
                pattern = pattern.strip('"')
                included = expand_home(pattern) if pattern.startswith("~") else path.parent / pattern
                with contextlib.suppress(ValueError):  # a pattern with NUL matches nothing
                    for name in sorted(glob.glob(str(included))):  # noqa: PTH207 - the pattern is absolute
                        _add_lines(Path(name), depth + 1, lines)
