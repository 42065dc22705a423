"""The file of the arm library, which stays intact when the process is killed while writing it."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from lupin_runtime.arm.library import Library, LibraryError, StoredPose, StoredSequence, from_json, to_json, valid_name
from lupin_runtime.atomic_file import write_atomically
from lupin_runtime.bounded_file import NotUtf8, read_bounded, read_bounded_text


def default_path() -> Path:
    """Return the path of `arm_library.json` in the user's configuration."""
    base = os.environ.get("XDG_CONFIG_HOME") or str(Path.home() / ".config")
    return Path(base) / "lupin" / "arm_library.json"


class LibraryStore:
    """A library and its file. A change takes effect once it is on the disk.

    A complete file has the library's name at every moment: the old file is copied to `.bak`, the new one is written beside it
    and synchronized, and then renamed. A corrupt file is moved aside and never overwritten.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._write_refusal = ""  # why the file must not be written, or empty
        self.library, self.complaint = self._load()

    def put(self, kind: str, name: str, entry: StoredPose | StoredSequence, overwrite: bool) -> str:
        """Store a pose or sequence; return its stored name. Raises LibraryError, or OSError if it cannot be written."""
        key = valid_name(name)
        table = self._table(kind)
        if key in table and not overwrite:
            raise LibraryError(f"{kind} {key!r} already exists; choose another name or overwrite it")
        self._commit(kind, {**table, key: entry})
        return key

    def delete(self, kind: str, name: str) -> None:
        """Delete an entry. Raises LibraryError or OSError."""
        table = self._table(kind)
        key = self._existing(kind, name)
        self._commit(kind, {other: entry for other, entry in table.items() if other != key})

    def rename(self, kind: str, name: str, new_name: str) -> str:
        """Rename an entry; return the stored name. Raises LibraryError, also if the name is taken, or OSError."""
        key, new_key = self._existing(kind, name), valid_name(new_name)
        table = self._table(kind)
        if new_key != key and new_key in table:
            raise LibraryError(f"{kind} {new_key!r} already exists; choose another name")
        self._commit(kind, {new_key if other == key else other: entry for other, entry in table.items()})
        return new_key

    def get(self, kind: str, name: str) -> Any:
        """Return the entry called `name`. Raises LibraryError, which lists the entries."""
        return self._table(kind)[self._existing(kind, name)]

    def listing(self) -> str:
        """Return the names and properties of all entries as JSON, for consoles."""
        poses = [
            {"name": name, "note": pose.note, "has_gripper": pose.gripper is not None}
            for name, pose in sorted(self.library.poses.items())
        ]
        sequences = [
            {
                "name": name,
                "mode": sequence.mode,
                "duration_s": sequence.duration_s,
                "n_waypoints": len(sequence.waypoints),
                "include_gripper": sequence.include_gripper,
            }
            for name, sequence in sorted(self.library.sequences.items())
        ]
        return json.dumps({"poses": poses, "sequences": sequences})

    def _table(self, kind: str) -> dict[str, Any]:
        if kind not in ("pose", "sequence"):
            raise LibraryError(f"kind is {kind!r}, expected pose or sequence")
        return self.library.poses if kind == "pose" else self.library.sequences

    def _existing(self, kind: str, name: str) -> str:
        key, table = valid_name(name), self._table(kind)
        if key not in table:
            raise LibraryError(f"no {kind} {key!r}; there are: {', '.join(sorted(table)) or 'none'}")
        return key

    def _commit(self, kind: str, table: dict[str, Any]) -> None:
        changed = Library(dict(self.library.poses), dict(self.library.sequences))
        setattr(changed, "poses" if kind == "pose" else "sequences", table)
        self._write(to_json(changed))
        self.library = changed

    def _write(self, text: str) -> None:
        if self._write_refusal:
            raise LibraryError(self._write_refusal)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        if self.path.exists():
            write_atomically(self.path.with_name(self.path.name + ".bak"), read_bounded(self.path))
        write_atomically(self.path, text, sync=True)

    def _load(self) -> tuple[Library, str]:
        """Return the library, and a message about its file, which is empty if the file is valid or missing."""
        try:
            return from_json(read_bounded_text(self.path)), ""
        except FileNotFoundError:
            return Library(), ""
        except (LibraryError, NotUtf8) as error:
            return Library(), self._move_aside(f"{self.path}: {error}")
        except OSError as error:
            self._write_refusal = (
                f"{self.path} cannot be read ({error.strerror}), so it is not written either; make it readable"
            )
            return Library(), self._write_refusal

    def _move_aside(self, found: str) -> str:
        number = 1
        while (aside := self.path.with_name(f"{self.path.stem}.corrupt-{number}.json")).exists():
            number += 1
        try:
            self.path.replace(aside)
        except OSError as error:
            self._write_refusal = (
                f"{found}; it cannot be moved aside ({error.strerror}), so nothing is written; move it manually"
            )
            return self._write_refusal
        return f"{found}; it was moved to {aside} and the library starts empty"
