"""The consoles of other computers that this user has accepted: the authority of each, and the cookie that pairs with it.

Each has a file of its own in `${XDG_STATE_HOME:-~/.local/state}/lupin/console/paired/`, which only its owner may read.
"""

from __future__ import annotations

import json
import re
import stat
from dataclasses import asdict, dataclass, field
from pathlib import Path
from urllib.parse import quote

from lupin_cli.printed_commands import lupin
from lupin_runtime.atomic_file import MalformedFile, write_atomically
from lupin_runtime.bounded_file import read_bounded_text
from lupin_runtime.console.description import serves_only_this_computer
from lupin_runtime.json_text import parse_json
from lupin_runtime.ports import CONSOLE_PORT
from lupin_runtime.stack.runs import make_state_folder, state_directory

_MAX_BYTES = 100_000
_MAX_HOST = 253  # letters of a name (RFC 1035)
_ADDRESS = re.compile(
    r"(?:https?://)?(?:\[(?P<v6>[0-9A-Fa-f:.]+(?:%[\w.-]+)?)\]|(?P<host>[\w.-]+))(?::(?P<port>\d{1,5}))?/?", re.ASCII
)
_BARE_V6 = re.compile(r"[0-9A-Fa-f:.]*:[0-9A-Fa-f:.]*:[0-9A-Fa-f:.]*(?:%[\w.-]+)?", re.ASCII)
_COOKIE = re.compile(r"[\w-]{1,64}=[\x21-\x2b\x2d-\x3a\x3c-\x7e]{1,400}", re.ASCII)  # without comma and semicolon


class BadAddress(ValueError):
    """A text that names no console; the message says what is expected."""


@dataclass(frozen=True)
class ConsoleAddress:
    """Where a console listens: a name or an address, and the port of its page."""

    host: str
    port: int = CONSOLE_PORT

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return host if self.port == CONSOLE_PORT else f"{host}:{self.port}"

    @property
    def is_of_this_computer(self) -> bool:
        """Whether it is reached without a network: the console pairs such a program by itself."""
        return serves_only_this_computer(self.host)

    def url(self, scheme: str) -> str:
        """Return the URL of its page, without a slash at its end."""
        return f"{scheme}://{f'[{self.host}]' if ':' in self.host else self.host}:{self.port}"

    def command(self, *words: str) -> str:
        """Return the `lupin voice` that uses it."""
        return lupin("voice", "--console", str(self), *words)


def parse_address(text: str) -> ConsoleAddress:
    """Return the address in HOST, HOST:PORT or the URL of a page. Raises BadAddress."""
    stripped = text.strip()
    match = _ADDRESS.fullmatch(stripped)
    host = stripped if _BARE_V6.fullmatch(stripped) else (match["v6"] or match["host"]) if match else ""
    port = int(match["port"]) if match and match["port"] else CONSOLE_PORT
    if not host or host.startswith("-") or len(host) > _MAX_HOST or not 0 < port < 65536:
        raise BadAddress(f"{text[:100]!r} is not HOST or HOST:PORT of a console, for example robot.local:{CONSOLE_PORT}")
    return ConsoleAddress(host.lower(), port)


@dataclass(frozen=True)
class KnownConsole:
    """An accepted console. `root` is the certificate of its authority, in PEM; `cookie` is empty until this user is paired."""

    root: str
    cookie: str = field(default="", repr=False)


def console_file(address: ConsoleAddress) -> Path:
    """Return the file of a console."""
    return state_directory() / "console" / "paired" / f"{quote(address.host, safe='')}_{address.port}.json"


def read_known(address: ConsoleAddress) -> KnownConsole | None:
    """Return what is known of a console; None if it has not been accepted. Raises MalformedFile and OSError."""
    path = console_file(address)
    again = f"forget it, and pair again: {address.command('--forget')}"
    try:
        others = stat.S_IMODE(path.stat().st_mode) & 0o077
        text = read_bounded_text(path, _MAX_BYTES)
    except FileNotFoundError:
        return None
    if others:
        raise MalformedFile(path, None, f"others on this computer may read it; {again}")
    try:
        known = KnownConsole(**parse_json(text))
        is_valid = all(isinstance(value, str) for value in asdict(known).values())
    except (ValueError, TypeError) as error:
        raise MalformedFile(path, None, f"{error}; {again}") from error
    if not is_valid or (known.cookie and not is_cookie(known.cookie)):
        raise MalformedFile(path, None, f"expected the texts root and cookie; {again}")
    return known


def is_cookie(text: str) -> bool:
    """Return whether a text is a cookie's name and value, and nothing else that a header might contain."""
    return _COOKIE.fullmatch(text) is not None


def write_known(address: ConsoleAddress, known: KnownConsole) -> None:
    """Store what is known of a console. Raises OSError."""
    path = console_file(address)
    make_state_folder(path.parent)
    write_atomically(path, json.dumps(asdict(known)), mode=0o600, sync=True)


def forget_known(address: ConsoleAddress) -> bool:
    """Forget a console; returns whether it was known. Raises OSError."""
    try:
        console_file(address).unlink()
    except FileNotFoundError:
        return False
    return True
