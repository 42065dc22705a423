"""`laptop-dds`: the laptop joins the robot's graph in every new terminal, or no longer does."""

from __future__ import annotations

import base64
import os
from pathlib import Path
from typing import Any, ClassVar

from lupin_cli import dds_setup
from lupin_cli.config import config_directory
from lupin_cli.operations.base import Difference
from lupin_cli.operations.paths import read_entry, unified_diff
from lupin_cli.operations.shell import change, quote
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Target


@dataclass(frozen=True, kw_only=True)
class LaptopDds:
    """What `lupin dds setup ADDRESS` writes: profile, exports and the hook in the shell's start file."""

    name: ClassVar[str] = "laptop-dds"

    address: str = ""
    present: bool = True
    machine: str = "laptop"

    def __post_init__(self) -> None:
        if self.machine != "laptop":
            raise ValueError("it is for the laptop: on: laptop")
        if self.present:
            dds_setup.valid_ip(self.address)

    def _wanted(self, target: Target) -> dict[Path, tuple[bytes | None, bytes | None]]:
        """What is and what should be of each file; None where there is or should be none."""
        places = dds_setup.Places(Path(os.environ.get("HOME") or Path.home()), config_directory())
        shell = Path(os.environ.get("SHELL") or "bash").name
        start = places.start_file(shell if shell in dds_setup.START_FILES else "bash", os.environ)
        old = {path: target.get(str(path)) for path in (places.profile, places.exports, start)}
        text = None if old[start] is None else (old[start] or b"").decode("utf-8", "surrogateescape")
        new: dict[Path, str | None]
        if self.present:
            profile, lines = dds_setup.profile_xml(self.address), dds_setup.exports(self.address, places)
            new = {places.profile: profile, places.exports: lines, start: dds_setup.with_hook(text, places)}
        else:
            hooked = text is not None and bool(dds_setup.hooks(text))
            new = {places.profile: None, places.exports: None, start: dds_setup.without_hook(text or "") if hooked else text}
        return {path: (old[path], None if t is None else t.encode("utf-8", "surrogateescape")) for path, t in new.items()}

    def differs(self, target: Target) -> Difference | None:
        changed = {path: pair for path, pair in self._wanted(target).items() if pair[0] != pair[1]}
        if not changed:
            return None
        what = f"joins the robot at {self.address}" if self.present else "no longer joins a robot"
        diff = "\n".join(unified_diff(str(path), old, new) for path, (old, new) in changed.items())
        before = {str(path): None if old is None else base64.b64encode(old).decode() for path, (old, _) in changed.items()}
        return Difference(f"this machine {what}: {', '.join(path.name for path in changed)}", diff, {"files": before})

    def change(self, target: Target, difference: Difference) -> None:
        for path, (old, new) in self._wanted(target).items():
            if old != new:
                _write(target, path, new)

    def undo(self, target: Target, before: dict[str, Any]) -> None:
        for path, text in before["files"].items():
            _write(target, Path(path), None if text is None else base64.b64decode(text))


def _write(target: Target, path: Path, data: bytes | None) -> None:
    real = path.resolve()  # a start file may be a link into a folder of such files
    if data is None:
        change(target, f"rm -f -- {quote(str(real))}", f"remove {path}")
        return
    change(target, f"mkdir -p -- {quote(str(real.parent))}", f"make {path.parent}")
    entry = read_entry(target, str(real), False)
    target.put(str(real), data, mode=int(entry.mode, 8) if entry.mode else 0o644)
