"""Printing of text that comes from elsewhere: from a robot, a network or a file.

A terminal obeys escape sequences, so all such text must pass through `printable` before a person sees it, usually in `echo`.
JSON does not need this: it escapes control characters itself.
"""

from __future__ import annotations

import contextlib
import re
import sys
from collections.abc import Iterator

import typer

# All control characters (ASCII's, DEL and the C1 set, in which U+009B begins a sequence) except tabs and line feeds.
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")
_ERASE_LINE = "\r\x1b[K"


def printable(text: str) -> str:
    """Replace each control character except tabs and line breaks by U+FFFD."""
    return _CONTROL.sub("\N{REPLACEMENT CHARACTER}", text.replace("\r\n", "\n"))


def echo(message: object = "", *, err: bool = False, nl: bool = True) -> None:
    """Print `message` without control characters on standard output, or on standard error with `err`."""
    typer.echo(printable(str(message)), err=err, nl=nl)


def is_interactive() -> bool:
    """Return whether a person can be asked: standard input and standard error are a terminal."""
    return sys.stdin.isatty() and sys.stderr.isatty()


@contextlib.contextmanager
def status_line(text: str, *, shown: bool) -> Iterator[None]:
    """Show `text` on standard error as long as the block takes, then erase it. Nothing is shown unless `shown`."""
    if shown:
        print(printable(text), end="", file=sys.stderr, flush=True)
    try:
        yield
    finally:
        if shown:
            erase_status_line()


def erase_status_line() -> None:
    """Erase the line that the cursor is on, to make room for a question."""
    print(_ERASE_LINE, end="", file=sys.stderr, flush=True)
