"""The file that tells `lupin up` and `lupin console` where a console listens and which codes pair a browser with it."""

from __future__ import annotations

import ipaddress
import json
from dataclasses import asdict, dataclass
from pathlib import Path

from lupin_runtime.atomic_file import write_atomically
from lupin_runtime.bounded_file import read_bounded_text
from lupin_runtime.console.host_addresses import host_addresses
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

    def lan_urls(self) -> list[str]:
        """Return the page's URLs for browsers on other computers; empty if only this computer is served."""
        if self.host in ("127.0.0.1", "localhost", "::1"):
            return []
        scheme = "https" if self.tls else "http"
        found = host_addresses().addresses if self.host in ("", "0.0.0.0", "::") else [ipaddress.ip_address(self.host)]
        return [f"{scheme}://{f'[{each}]' if each.version == 6 else each}:{self.port}/" for each in found]

    def write(self, folder: Path) -> None:
        """Write the file, which only its owner may read, because it contains the codes."""
        write_atomically(folder / _NAME, json.dumps(asdict(self)), mode=0o600)


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
