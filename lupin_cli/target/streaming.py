"""One script with its standard input and its output as it comes: the program, and the reader of its streams."""

from __future__ import annotations

import codecs
import math
import secrets
import shlex
from collections.abc import Callable
from dataclasses import dataclass

from lupin_cli.target.base import Output
from lupin_cli.target.framing import ENVIRONMENT, READ_PROGRAM, SKIP_PASSWORD, sudo_check, sudo_command

KEPT_BYTES = 32 * 1024 * 1024  # of each stream; `on_line` gets all of it


@dataclass(frozen=True)
class RunProgram:
    """A script as it goes over the wire; it writes `mark` to both its streams once it runs as whom it should."""

    command: str
    payload: bytes
    mark: bytes


def run_program(script: str, *, root: bool, stdin: bytes, bound_s: float, sudo_password: str | None) -> RunProgram:
    """The program that runs `script` with `stdin`, ended at `bound_s` also where nobody is left to end it.

    The shell reads no further than its own text, so that what follows is the script's standard input, byte for byte.
    """
    mark = f"lupin-{secrets.token_hex(8)}"
    # The shell's stdin is the script's: `head` takes the text and no byte more.
    text = f"{ENVIRONMENT}printf '{mark}\\n'; printf '{mark}\\n' >&2\n{script}\n".encode("utf-8", "surrogateescape")
    inner = f'eval "$(head -c {len(text)})"'
    bounded = f"timeout -k 2 {max(1, math.ceil(bound_s))} /bin/sh -c {shlex.quote(inner)}"
    lead = b""
    if root:
        # As root already: no sudo. With a password: sudo may or may not have read its line.
        after_sudo = shlex.quote(f"{SKIP_PASSWORD}; exec {bounded}")
        start = (
            f'{ENVIRONMENT}if [ "$(id -u)" = 0 ]; then {SKIP_PASSWORD}; exec {bounded}; else '
            f"{sudo_check(sudo_password)} || exit 1; exec {sudo_command(sudo_password)} /bin/sh -c {after_sudo}; fi\n"
        ).encode()
        lead = (b"" if sudo_password is None else sudo_password.encode() + b"\n") + b"lupin-begins\n"
    else:
        start = f"{ENVIRONMENT}exec {bounded}\n".encode()
    return RunProgram(READ_PROGRAM.format(size=len(start)), start + lead + text + stdin, mark.encode())


class Streams:
    """Collects both streams of a run and hands out their lines.

    What stands before the mark was said by the login shell's start files or sudo's lecture, and isn't the script's.
    """

    def __init__(self, mark: bytes, on_line: Callable[[str], None] | None) -> None:
        self._mark = mark + b"\n"
        self._kept = (bytearray(), bytearray())
        self._dropped = False
        self._on_line = on_line
        self._decoders = tuple(codecs.getincrementaldecoder("utf-8")("backslashreplace") for _ in range(2))
        self._lines = ["", ""]
        self._marked = [False, False]

    @property
    def marked(self) -> bool:
        """Whether the script came to run."""
        return any(self._marked)

    def feed(self, data: bytes, is_stderr: bool) -> None:
        """Take the next bytes of one stream."""
        kept = self._kept[is_stderr]
        if not self._marked[is_stderr]:
            kept += data
            place = kept.find(self._mark)
            if place < 0:
                return
            self._marked[is_stderr] = True
            data = bytes(kept[place + len(self._mark) :])
            kept.clear()
        room = KEPT_BYTES - len(kept)
        kept += data[:room]
        self._dropped |= len(data) > room
        if self._on_line is not None:
            *lines, rest = (self._lines[is_stderr] + self._decoders[is_stderr].decode(data)).split("\n")
            self._lines[is_stderr] = rest[-KEPT_BYTES:]
            for line in lines:
                self._on_line(line)

    @property
    def last_error(self) -> str:
        """The last thing that was said on standard error."""
        lines = self._kept[1].decode("utf-8", "backslashreplace").strip().splitlines()
        return lines[-1] if lines else "nothing was said"

    def output(self, status: int | None, duration_s: float, bound_s: float) -> Output:
        """The run as an Output. A status that `timeout` gives at the bound counts as cut."""
        if self._on_line is not None:
            for rest in self._lines:
                if rest:
                    self._on_line(rest)
        if status in (124, 137, 143) and duration_s >= bound_s - 0.05:
            status = None
        stdout, stderr = (bytes(kept).decode("utf-8", "backslashreplace") for kept in self._kept)
        if status is None and not stderr:
            stderr = f"no end within {bound_s:g} s"
        return Output(status, stdout, stderr, duration_s, self._dropped or status is None)
