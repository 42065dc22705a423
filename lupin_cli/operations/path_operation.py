"""The part that `file` and `directory` share: a path with a mode and an owner, present or absent."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import ClassVar

from lupin_cli.operations.base import Operation
from lupin_cli.operations.path_state import PathState

_MODE = re.compile(r"0?[0-7]{3,4}\Z")
_EXACT_DIGITS = 5
# A new folder inherits the set-group-ID bit of its parent, and chmod keeps both bits of a folder unless its mode has five
# digits: info coreutils, "Directories and the Set-User-ID and Set-Group-ID Bits".
_KEPT_OF_FOLDERS = 0o6000


@dataclass(frozen=True, kw_only=True)
class PathOperation(Operation):
    """Examines and sets `mode` and `owner` only if they are given. `root` runs everything as root."""

    prefetchable: ClassVar[bool] = True

    path: str
    mode: str | None = None  # octal: "0644"
    owner: str | None = None  # user:group
    present: bool = True
    root: bool = False

    def __post_init__(self) -> None:
        if self.mode is not None and not _MODE.match(self.mode):
            digits = 'three octal digits, or four with the special bits, in quotes, such as "0644" or "2775"'
            raise ValueError(f"a mode is {digits}, not {self.mode!r}")
        if self.owner is not None and ":" not in self.owner:
            raise ValueError(f"an owner is user:group, not {self.owner!r}")

    def _has_mode(self, state: PathState) -> bool:
        """Return whether the bits that `mode` names are set, and no others that chmod would clear."""
        assert self.mode is not None
        found, wanted = int(state.mode or "0", 8), int(self.mode, 8)
        if state.kind == "directory" and len(self.mode) < _EXACT_DIGITS:
            wanted |= found & _KEPT_OF_FOLDERS
        return found == wanted

    def attribute_changes(self, state: PathState) -> list[str]:
        """Describe in words how mode and owner differ."""
        changes = []
        if self.mode is not None and not self._has_mode(state):
            changes.append(f"mode {state.mode} → {self.mode}")
        if self.owner is not None and state.owner != self.owner:
            changes.append(f"owner {state.owner} → {self.owner}")
        return changes
