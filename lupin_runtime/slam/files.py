"""Files that are either whole or untouched, and the error that names the line of one that makes no sense."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path


class MalformedFile(ValueError):
    """A file that cannot be read as what it claims to be; the message names file and line."""

    def __init__(self, path: Path | str, line: int | None, problem: str) -> None:
        self.path, self.line, self.problem = Path(path), line, problem
        super().__init__(f"{path}:{line}: {problem}" if line is not None else f"{path}: {problem}")


def write_atomically(path: Path, content: bytes) -> None:
    """Replace `path` by `content`: after a crash or a full disk the old file or the new one is there, never half of one.

    Raises OSError; the old file then stays.
    """
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    temporary = Path(name)
    try:
        with os.fdopen(handle, "wb") as out:
            out.write(content)
            out.flush()
            os.fsync(out.fileno())
        temporary.chmod(0o644)
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
