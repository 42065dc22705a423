"""Files that are replaced in one step: a reader sees the old content or the new, never half of one."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from lupin_runtime.bounded_file import read_bounded_text
from lupin_runtime.json_text import parse_json


class MalformedFile(ValueError):
    """A file whose content is not of the expected format; the message names the file and, if it is known, the line."""

    def __init__(self, path: Path | str, line: int | None, problem: str) -> None:
        self.path, self.line, self.problem = Path(path), line, problem
        super().__init__(f"{path}:{line}: {problem}" if line is not None else f"{path}: {problem}")


def write_atomically(path: Path, content: str | bytes, *, mode: int | None = None, sync: bool = False) -> None:
    """Replace `path` by `content` (text as UTF-8), with permissions `mode`.

    Without `mode`, the umask decides; in a folder that others may not enter, such as a run's, only its owner may read the file.
    With `sync` the content is on the disk before it gets its name: a power cut leaves the old file or the new one. Without,
    a power cut may cost the content. Raises OSError, for example if the disk is full; the old file then stays.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.{os.urandom(4).hex()}")
    try:
        created = mode if mode is not None else 0o666 if path.parent.stat().st_mode & 0o077 else 0o600
        with os.fdopen(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, created), "wb") as file:
            if mode is not None:
                os.fchmod(file.fileno(), mode)
            file.write(content.encode() if isinstance(content, str) else content)
            if sync:
                file.flush()
                os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def read_json_object(path: Path) -> dict[str, Any]:
    """Return the JSON object in a file; {} if the file is missing, unreadable or holds anything else."""
    try:
        content = parse_json(read_bounded_text(path))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}
