"""Opens and reads files that come from elsewhere: only regular files, and only up to a size.

A path that somebody else chose may lead to a named pipe, which blocks, to /dev/zero, which never ends, or to a file that fills
the memory. Here each of them is an OSError, whose `strerror` says what is wrong.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO

MAX_TEXT_BYTES = 16 << 20  # of a configuration, a journal or a document: far above what people and programs write
MAX_IMAGE_BYTES = 512 << 20
MAX_TRAJECTORY_BYTES = 256 << 20  # a TUM line has 100 bytes: a day at 20 Hz

_KINDS = {
    stat.S_IFIFO: "a named pipe",
    stat.S_IFDIR: "a folder",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


def open_regular(path: Path | str) -> BinaryIO:
    """Open a file for reading, without waiting for the writer of a pipe. Raises OSError, also for what is not a file."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY)
    except ValueError as error:  # NUL, or a character that no name of a file has
        raise OSError(errno.EINVAL, f"is not a name of a file ({error}); choose another", repr(str(path))) from error
    kind = stat.S_IFMT(os.fstat(descriptor).st_mode)
    if kind != stat.S_IFREG:
        os.close(descriptor)
        raise OSError(errno.EINVAL, f"is {_KINDS.get(kind, 'something else')}; expected a file", str(path))
    return os.fdopen(descriptor, "rb")


def read_bounded(path: Path | str, max_bytes: int = MAX_TEXT_BYTES) -> bytes:
    """Return the content of a file. Raises OSError, also for a larger file and for what is not a file."""
    with open_regular(path) as file:
        content = file.read(max_bytes + 1)
    if len(content) > max_bytes:
        raise OSError(errno.EFBIG, f"is larger than {max_bytes} bytes, the limit for such a file", str(path))
    return content


def read_bounded_text(path: Path | str, max_bytes: int = MAX_TEXT_BYTES, errors: str = "strict") -> str:
    """Return the text of a UTF-8 file, its line ends as line feeds. Raises OSError and UnicodeDecodeError."""
    return read_bounded(path, max_bytes).decode("utf-8", errors).replace("\r\n", "\n").replace("\r", "\n")


def is_file(path: Path | str) -> bool:
    """Return whether a path leads to a file. `Path.is_file` raises for a name that is too long; here it is none."""
    try:
        return Path(path).is_file()
    except (OSError, ValueError):
        return False


def is_folder(path: Path | str) -> bool:
    """Return whether a path leads to a folder; see `is_file`."""
    try:
        return Path(path).is_dir()
    except (OSError, ValueError):
        return False


def expand_home(name: str) -> Path:
    """Return a path with a leading ~ replaced; it stays for a user who does not exist, for whom `expanduser` raises."""
    try:
        return Path(name).expanduser()
    except RuntimeError:
        return Path(name)
