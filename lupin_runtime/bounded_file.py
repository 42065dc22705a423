"""Opens and reads files that come from elsewhere: only regular files, only up to a size, and text as UTF-8.

A path that somebody else chose may lead to a named pipe, which blocks, to /dev/zero, which never ends, or to a file that fills
the memory. Here each of them is an OSError, whose `strerror` says what is wrong.
"""

from __future__ import annotations

import codecs
import errno
import io
import os
import stat
from pathlib import Path
from typing import BinaryIO, TextIO

MAX_TEXT_BYTES = 16 << 20  # of a configuration, a journal or a document: far above what people and programs write
MAX_IMAGE_BYTES = 512 << 20
MAX_TRAJECTORY_BYTES = 256 << 20  # a TUM line has 100 bytes: a day at 20 Hz

# The byte order marks of Unicode 16, 23.8, that no UTF-8 text begins with. That of UTF-32 begins with that of UTF-16.
_OTHER_MARKS = {
    codecs.BOM_UTF32_LE: "UTF-32",
    codecs.BOM_UTF32_BE: "UTF-32",
    codecs.BOM_UTF16_LE: "UTF-16",
    codecs.BOM_UTF16_BE: "UTF-16",
}
_ASCII = frozenset((*b"\t\r\n", *range(0x20, 0x7F)))  # of text
_ENCODING = "utf-8-sig"  # UTF-8, of which a byte order mark at the beginning is no part of the text


class NotUtf8(OSError):
    """A text file in another encoding, with the line and column of the first byte that shows it."""

    def __init__(self, problem: str, path: Path | str, line: int = 1, column: int = 1) -> None:
        self.problem, self.line, self.column = f"{problem}; save it as UTF-8", line, column
        super().__init__(errno.EILSEQ, self.problem, str(path))


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
    """Return the text of a file, as `decode_text` does. Raises OSError, also for another encoding."""
    return decode_text(read_bounded(path, max_bytes), path, errors)


def decode_text(content: bytes, path: Path | str, errors: str = "strict") -> str:
    """Return the text of a UTF-8 file without its byte order mark, its line ends as line feeds.

    Raises NotUtf8, which is an OSError.
    """
    _refuse_other_encoding(content, path)
    try:
        text = content.decode(_ENCODING, errors)
    except UnicodeDecodeError as error:
        before = content[: error.start]
        line, column = before.count(b"\n") + 1, error.start - before.rfind(b"\n")
        problem = f"is not UTF-8 here: line {line}, column {column}, byte 0x{content[error.start]:02x}"
        raise NotUtf8(problem, path, line, column) from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


def open_text(path: Path | str) -> TextIO:
    """Open a text file, for one that is read line by line; what is not UTF-8 is replaced. Raises OSError."""
    file = open_regular(path)
    try:
        _refuse_other_encoding(file.read(4), path)
        file.seek(0)
        return io.TextIOWrapper(file, encoding=_ENCODING, errors="replace")
    except BaseException:
        file.close()
        raise


def _refuse_other_encoding(head: bytes, path: Path | str) -> None:
    name = next((name for mark, name in _OTHER_MARKS.items() if head.startswith(mark)), "")
    # Without a mark, the first character of nearly any text shows: a zero byte beside one of ASCII.
    if not name and len(head) > 1 and 0 in head[:2] and max(head[:2]) in _ASCII:
        name = "UTF-16"
    if name:
        raise NotUtf8(f"is {name}", path)


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
