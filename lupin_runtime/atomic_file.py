"""Files that are replaced in one step: a reader sees the old content or the new, never half of one."""

from __future__ import annotations

import os
from pathlib import Path


class MalformedFile(ValueError):
    """A file whose content is not of the expected format; the message names the file and, if it is known, the line."""

    def __init__(self, path: Path | str, line: int | None, problem: str) -> None:
        self.path, self.line, self.problem = Path(path), line, problem
        super().__init__(f"{path}:{line}: {problem}" if line is not None else f"{path}: {problem}")


def write_atomically(path: Path, content: str | bytes, *, mode: int = 0o644, sync: bool = False) -> None:
    """Replace `path` by `content` (text as UTF-8), with permissions `mode`.

    With `sync` the content is on the disk before it gets its name: a power cut leaves the old file or the new one. Without,
    a power cut may cost the content. Raises OSError, for example if the disk is full; the old file then stays.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.{os.urandom(4).hex()}")
    try:
        with os.fdopen(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode), "wb") as file:
            os.fchmod(file.fileno(), mode)
            file.write(content.encode() if isinstance(content, str) else content)
            if sync:
                file.flush()
                os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
