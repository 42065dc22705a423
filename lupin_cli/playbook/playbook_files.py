"""Find and load playbooks: those that Lupin ships, and the operator's files."""

from __future__ import annotations

from pathlib import Path

from lupin_cli.package_data import shipped_folder
from lupin_cli.playbook.model import Playbook
from lupin_cli.playbook.yaml_source import suggest
from lupin_runtime.bounded_file import expand_home, is_file


def list_shipped() -> list[Path]:
    """Return the files of all shipped playbooks, sorted by name."""
    return sorted(shipped_folder("playbooks").glob("*.yaml"))


def find_playbook(name: str, folder: Path | None = None) -> Path:
    """Return the file of the playbook `name`: a path, a file in `folder`, or a shipped one. FileNotFoundError names the
    most similar one."""
    if name.endswith((".yaml", ".yml")) or "/" in name:
        path = (folder or Path()) / expand_home(name)
        if not is_file(path):
            raise FileNotFoundError(f"there is no file {str(path)!r}; shipped playbooks: lupin play --list")
        return path
    for candidate in (*([folder / f"{name}.yaml"] if folder else []), shipped_folder("playbooks") / f"{name}.yaml"):
        if is_file(candidate):
            return candidate
    known = {path.stem for path in list_shipped()} | ({path.stem for path in folder.glob("*.yaml")} if folder else set())
    raise FileNotFoundError(f"there is no playbook {name!r}{suggest(name, known)}")


def load(name: str | Path) -> Playbook:
    """Return a checked playbook by its name or file; raises FileNotFoundError or PlaybookError."""
    from lupin_cli.operations.table import OPERATIONS
    from lupin_cli.playbook.parser import read_playbook

    path = name if isinstance(name, Path) else find_playbook(name)
    return read_playbook(path, OPERATIONS, find_playbook)
