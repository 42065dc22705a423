"""Where playbooks are: shipped with Lupin, or a file of the operator's."""

from __future__ import annotations

from pathlib import Path

from lupin_cli.runbook.language import Playbook
from lupin_cli.runbook.source import nearest
from lupin_cli.shipped import shipped_folder


def shipped() -> list[Path]:
    """The files of all shipped playbooks, by name."""
    return sorted(shipped_folder("playbooks").glob("*.yaml"))


def find_playbook(name: str, folder: Path | None = None) -> Path:
    """The file that `name` means: a path, a file in `folder`, or a shipped one. FileNotFoundError names the nearest."""
    if name.endswith((".yaml", ".yml")) or "/" in name:
        path = (folder or Path()) / Path(name).expanduser()
        if not path.is_file():
            raise FileNotFoundError(f"there is no file {str(path)!r}; shipped playbooks: lupin play --list")
        return path
    for candidate in (*([folder / f"{name}.yaml"] if folder else []), shipped_folder("playbooks") / f"{name}.yaml"):
        if candidate.is_file():
            return candidate
    known = {path.stem for path in shipped()} | ({path.stem for path in folder.glob("*.yaml")} if folder else set())
    raise FileNotFoundError(f"there is no playbook {name!r}{nearest(name, known)}")


def load(name: str | Path) -> Playbook:
    """A checked playbook by its name or file; raises FileNotFoundError or PlaybookError."""
    from lupin_cli.operations import OPERATIONS
    from lupin_cli.runbook.reading import read_playbook

    path = name if isinstance(name, Path) else find_playbook(name)
    return read_playbook(path, OPERATIONS, find_playbook)
