"""Reads the secrets of a playbook run where nobody else sees them: typed without echo, from a file, or from standard input."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import BinaryIO

from lupin_cli.connection.options import ask_hidden
from lupin_cli.playbook.model import Playbook
from lupin_cli.playbook.yaml_source import suggest
from lupin_cli.terminal import is_interactive

MAX_BYTES = 64 * 1024
_TYPES = ("secret", "text")


class SecretError(Exception):
    """A secret cannot be read; the message says why, and never contains it."""


def read_secrets(playbook: Playbook, words: Sequence[str], given: Mapping[str, object], *, ask_missing: bool) -> dict[str, str]:
    """Return the values of `--hidden NAME`, `NAME=FILE` and `NAME=-`.

    With `ask_missing`, the secrets that the playbook needs and that are not in `given` are asked for, if there is a terminal.
    Raises SecretError.
    """
    variables = {variable.name: variable for variable in playbook.variables}
    found: dict[str, str] = {}
    for word in words:
        name, equals, source = word.partition("=")
        if name not in variables:
            raise SecretError(f"{playbook.name!r} has no variable {name!r}{suggest(name, variables)}")
        if variables[name].type not in _TYPES:
            raise SecretError(f"{name!r} is of type {variables[name].type}: give it as -v {name}=...")
        if name in found or name in given:
            raise SecretError(f"{name!r} is given twice")
        if source == "-" and any(other.endswith("=-") for other in words if other != word):
            raise SecretError("standard input has one secret only: read the others from files")
        if not equals or (source == "-" and sys.stdin.isatty()):
            found[name] = _ask(name, variables[name].help)
        else:
            found[name] = _read_standard_input() if source == "-" else _read_file(name, source)
    if ask_missing and is_interactive():
        for name, variable in variables.items():
            if variable.type == "secret" and not variable.has_default and name not in found and name not in given:
                found[name] = _ask(name, variable.help)
    return found


def _ask(name: str, about: str) -> str:
    if not is_interactive():
        raise SecretError(f"nobody can be asked for {name!r} without a terminal: give --hidden {name}=FILE, or {name}=-")
    return ask_hidden(f"{name} ({about.rstrip('.')}): " if about else f"{name}: ")


def _read_file(name: str, path: str) -> str:
    if not path:
        raise SecretError(f"--hidden {name}= names no file; --hidden {name} asks for it")
    try:
        with Path(path).expanduser().open("rb") as file:
            return _decode(file, path)
    except (OSError, RuntimeError) as error:  # no file, or no such user
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise SecretError(f"{name!r} cannot be read from {path}: {reason}") from error


def _read_standard_input() -> str:
    return _decode(sys.stdin.buffer, "standard input")


def _decode(file: BinaryIO, where: str) -> str:
    """Return a text without its last line break. Raises SecretError."""
    data = file.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise SecretError(f"{where} has more than {MAX_BYTES} bytes, which is no secret")
    try:
        text = data.decode("utf-8-sig")  # without a byte order mark, but with its line breaks as they are
    except UnicodeDecodeError:
        raise SecretError(f"{where} is not UTF-8 text") from None  # the error would show the bytes
    text = text.removesuffix("\n").removesuffix("\r")
    if not text or "\0" in text:
        raise SecretError(f"{where} {'contains a NUL' if text else 'is empty'}")
    return text
