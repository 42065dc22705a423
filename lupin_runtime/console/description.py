"""Where a running console is, and the codes that pair a browser with it now: a file for `lupin up` and `lupin console`."""

from __future__ import annotations

import ipaddress
import json
from dataclasses import asdict, dataclass
from pathlib import Path

from lupin_runtime.atomic_file import write_atomically
from lupin_runtime.console.host_addresses import host_addresses

_NAME = "console.json"


@dataclass(frozen=True)
class ConsoleDescription:
    """A console that listens. `codes` is the one-time code of each role."""

    pid: int
    host: str
    port: int
    rosbridge_port: int
    codes: dict[str, str]
    tls: bool = False

    @property
    def url(self) -> str:
        """The page, for a browser on this computer."""
        return f"http://127.0.0.1:{self.port}/"

    def lan_urls(self) -> list[str]:
        """The page for browsers of other computers; none where only this one is served."""
        if self.host in ("127.0.0.1", "localhost", "::1"):
            return []
        scheme = "https" if self.tls else "http"
        found = host_addresses().addresses if self.host in ("", "0.0.0.0", "::") else [ipaddress.ip_address(self.host)]
        return [f"{scheme}://{f'[{each}]' if each.version == 6 else each}:{self.port}/" for each in found]

    def write(self, folder: Path) -> None:
        """Write it for its owner only, because of the codes."""
        write_atomically(folder / _NAME, json.dumps(asdict(self)), mode=0o600)


def read_description(folder: Path) -> ConsoleDescription | None:
    """The console whose files are in `folder`; None where none is running."""
    try:
        return ConsoleDescription(**json.loads((folder / _NAME).read_text()))
    except (OSError, ValueError, TypeError):
        return None


def remove_description(folder: Path) -> None:
    """To be called when the console has stopped."""
    (folder / _NAME).unlink(missing_ok=True)


def spoken(code: str) -> str:
    """A code as people read it aloud: in two halves."""
    return f"{code[: len(code) // 2]}-{code[len(code) // 2 :]}"
