"""The key of the voice service, in a file that only this user may read. It leaves this computer only to mint tokens."""

from __future__ import annotations

import re
import stat
from pathlib import Path

from lupin_runtime.atomic_file import MalformedFile, write_atomically
from lupin_runtime.bounded_file import read_bounded_text
from lupin_runtime.stack.runs import make_state_folder, state_directory

_KEY = re.compile(r"[\x21-\x7e]{20,400}")
SET_KEY = "lupin console voice set-key"


class BadKey(ValueError):
    """A text that is no key; the message, which does not contain it, says what is expected."""


def key_file() -> Path:
    """Return the file of this user's key."""
    return state_directory() / "console" / "voice_key"


def check_key(text: str) -> str:
    """Return the key in what a person typed or pasted. Raises BadKey."""
    key = text.strip()
    if not _KEY.fullmatch(key):
        raise BadKey(f"a key has 20 to 400 letters, digits and marks, without spaces; this text has {len(key)} characters")
    return key


def read_key(path: Path) -> str | None:
    """Return the stored key; None if there is none. Raises MalformedFile and OSError."""
    try:
        others = stat.S_IMODE(path.stat().st_mode) & 0o077
        text = read_bounded_text(path)
    except FileNotFoundError:
        return None
    if others:
        raise MalformedFile(path, None, f"others on this computer may read it; make a new key, and store it with: {SET_KEY}")
    try:
        return check_key(text)
    except BadKey as error:
        raise MalformedFile(path, None, f"{error}; store it again with: {SET_KEY}") from error


def write_key(path: Path, key: str) -> None:
    """Store a checked key. Raises OSError."""
    make_state_folder(path.parent)
    write_atomically(path, key + "\n", mode=0o600, sync=True)


def forget_key(path: Path) -> bool:
    """Delete the stored key; returns whether there was one. Raises OSError."""
    try:
        path.unlink()
    except FileNotFoundError:
        return False
    return True
