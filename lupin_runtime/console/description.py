"""The file that tells `lupin up` and `lupin console` where a console listens and which codes pair a browser with it."""

from __future__ import annotations

import ipaddress
import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from lupin_runtime.atomic_file import write_atomically
from lupin_runtime.bounded_file import read_bounded_text
from lupin_runtime.console.banner import console_urls
from lupin_runtime.console.host_addresses import HostAddresses, host_addresses
from lupin_runtime.json_text import parse_json

_NAME = "console.json"


@dataclass(frozen=True)
class ConsoleDescription:
    """A running console. `codes` is the current one-time code of each role; `rosbridge_port` is 0 if that port was in use."""

    pid: int
    host: str
    port: int
    rosbridge_port: int
    codes: dict[str, str]
    tls: bool = False

    @property
    def url(self) -> str:
        """The page's URL for a browser on this computer."""
        return f"http://127.0.0.1:{self.port}/"

    def network_urls(self) -> tuple[str, ...]:
        """Return the page's URLs for browsers on other devices; see the function of this name."""
        return network_urls(self.host, self.port, tls=self.tls)

    def write(self, folder: Path) -> None:
        """Write the file, which only its owner may read, because it contains the codes."""
        write_atomically(folder / _NAME, json.dumps(asdict(self)), mode=0o600)


def serves_only_this_computer(host: str) -> bool:
    """Return whether a console that listens on `host` cannot be reached from other devices."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def network_urls(host: str, port: int, *, tls: bool) -> tuple[str, ...]:
    """Return a console's URLs for browsers on other devices, the best first; an empty `host` listens on all addresses.

    Empty if only this computer is served, or if it has no address in a network. One port serves HTTP and HTTPS, and redirects
    other devices to HTTPS.
    """
    if serves_only_this_computer(host):
        return ()
    reachable = host_addresses()
    if host == "0.0.0.0":
        reachable = replace(reachable, addresses=tuple(each for each in reachable.addresses if each.version == 4))
    elif host not in ("", "::"):
        try:
            reachable = HostAddresses((), (ipaddress.ip_address(host),))
        except ValueError:
            return (f"{'https' if tls else 'http'}://{host}:{port}",)
    if not reachable.addresses:
        return ()  # the machine's own name leads nowhere, either
    return console_urls(reachable, https_port=port if tls else None, http_port=None if tls else port).network


def read_description(folder: Path) -> ConsoleDescription | None:
    """Read the description in `folder`; None if there is none, because no console is running, or if it is malformed."""
    try:
        return ConsoleDescription(**parse_json(read_bounded_text(folder / _NAME)))
    except (OSError, ValueError, TypeError):
        return None


def remove_description(folder: Path) -> None:
    """Remove the description. To be called when the console has stopped."""
    (folder / _NAME).unlink(missing_ok=True)


def spoken(code: str) -> str:
    """Return a code in two halves with a hyphen between them, which is easier to read aloud."""
    return f"{code[: len(code) // 2]}-{code[len(code) // 2 :]}"
