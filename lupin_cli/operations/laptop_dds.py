"""`laptop-dds`: new terminals on the laptop join the robot's graph, or no longer do."""

from __future__ import annotations

import base64
import binascii
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from lupin_cli.connection.base import Output, Script, Target
from lupin_cli.connection.inventory import config_directory
from lupin_cli.link import dds_setup
from lupin_cli.operations.base import Difference, Operation, OperationError, RestoredFile, probe_script
from lupin_cli.operations.path_state import unified_diff
from lupin_cli.operations.shell import change, query, quote, text_of

_ABSENT = "absent"


@dataclass(frozen=True, kw_only=True)
class LaptopDds(Operation):
    """The same as `lupin dds setup ADDRESS` writes: the profile, the exports, and the hook in the shell's startup file."""

    name: ClassVar[str] = "laptop-dds"
    effect: ClassVar[str] = "new terminals join the robot's graph, as after `lupin dds setup`, or no longer do"
    undo_effect: ClassVar[str] = "byte for byte"

    machine: str = "laptop"
    address: str = ""
    present: bool = True

    def __post_init__(self) -> None:
        if self.machine != "laptop":
            raise ValueError("it is for the laptop: on: laptop")
        if self.present:
            dds_setup.parse_robot_ip(self.address)

    def _files(self) -> tuple[dds_setup.SetupPaths, Path]:
        """Return the paths of profile and exports, and the startup file of the user's shell."""
        paths = dds_setup.SetupPaths(Path(os.environ.get("HOME") or Path.home()), config_directory())
        shell = Path(os.environ.get("SHELL") or "bash").name
        return paths, paths.start_file(shell if shell in dds_setup.START_FILES else "bash", os.environ)

    def probe(self) -> Script:
        paths, start = self._files()
        lines = [
            f"if [ -e {name} ]; then base64 -w 0 <{name} || exit 1; echo; else echo {_ABSENT}; fi"
            for name in (quote(str(path)) for path in (paths.profile, paths.exports, start))
        ]
        return probe_script("\n".join(lines))

    def _contents(self, output: Output) -> dict[Path, tuple[bytes | None, bytes | None]]:
        """Return each file's old and new content; None stands for no file."""
        paths, start = self._files()
        lines = text_of(output, "the DDS environment").splitlines()
        if len(lines) != 3:
            raise OperationError(f"could not read the DDS environment: found {output.stdout[:80]!r}", "lupin dds check")
        try:
            found = [None if line == _ABSENT else base64.b64decode(line, validate=True) for line in lines]
        except (binascii.Error, ValueError) as error:
            raise OperationError(f"could not read the DDS environment: {error}", "lupin dds check") from error
        old = dict(zip((paths.profile, paths.exports, start), found, strict=True))
        old_start = old[start]
        text = None if old_start is None else old_start.decode("utf-8", "surrogateescape")
        new: dict[Path, str | None]
        if self.present:
            profile, exports = dds_setup.profile_xml(self.address), dds_setup.exports_text(self.address, paths)
            new = {paths.profile: profile, paths.exports: exports, start: dds_setup.add_hook(text, paths)}
        else:
            hooked = text is not None and bool(dds_setup.find_hooks(text))
            new = {paths.profile: None, paths.exports: None, start: dds_setup.remove_hook(text or "") if hooked else text}
        return {path: (old[path], None if t is None else t.encode("utf-8", "surrogateescape")) for path, t in new.items()}

    def judge(self, output: Output) -> Difference | None:
        changed = {path: pair for path, pair in self._contents(output).items() if pair[0] != pair[1]}
        if not changed:
            return None
        action = f"join the robot at {self.address}" if self.present else "leave the robot's graph"
        diff = "\n".join(unified_diff(str(path), old, new) for path, (old, new) in changed.items())
        before = {str(path): None if old is None else base64.b64encode(old).decode() for path, (old, _) in changed.items()}
        return Difference(f"{action}: change {', '.join(path.name for path in changed)}", diff, {"files": before})

    def change(self, target: Target, difference: Difference) -> None:
        script = self.probe()
        for path, (old, new) in self._contents(query(target, script.text)).items():
            if old != new:
                _write(target, path, new)

    def restored_files(self) -> tuple[RestoredFile, ...]:
        paths, start = self._files()
        return tuple(RestoredFile(str(path.resolve())) for path in (paths.profile, paths.exports, start))

    def overwritten(self, output: Output) -> dict[str, bytes]:
        found = [old for old, _ in self._contents(output).values()]
        states = (b"absent" if old is None else b"file " + old for old in found)
        return {file.path: state for file, state in zip(self.restored_files(), states, strict=True)}

    def undo(self, target: Target, before: Mapping[str, Any]) -> None:
        for path, text in before["files"].items():
            _write(target, Path(path), None if text is None else base64.b64decode(text))


def _write(target: Target, path: Path, data: bytes | None) -> None:
    real = path.resolve()  # a startup file may be a link into a folder of such files
    if data is None:
        change(target, f"rm -f -- {quote(str(real))}", f"remove {path}")
        return
    change(target, f"mkdir -p -- {quote(str(real.parent))}", f"create {path.parent}")
    mode = query(target, f"stat -c %a -- {quote(str(real))} 2>/dev/null").stdout.strip()
    target.put(str(real), data, mode=int(mode, 8) if mode else 0o644)
