"""Where a running console is, and the codes that pair a browser with it now: a file for `lupin up` and `lupin console`."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from lupin_runtime.atomic_file import write_atomically

_NAME = "console.json"


@dataclass(frozen=True)
class ConsoleDescription:
    """A console that listens. `codes` is the one-time code of each role."""

    pid: int
    host: str
    port: int
    rosbridge_port: int
    codes: dict[str, str]

    @property
    def url(self) -> str:
        """The page, for a browser on this computer."""
        return f"http://127.0.0.1:{self.port}/"

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
