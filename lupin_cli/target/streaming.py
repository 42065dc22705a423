"""One script with its standard input and its output as it comes: the program, and the reader of its streams."""

from __future__ import annotations

import codecs
import math
import secrets
import shlex
from collections.abc import Callable

from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Output
from lupin_cli.target.framing import ENVIRONMENT, READ_PROGRAM, SKIP_PASSWORD, sudo_check, sudo_command

# Of each stream: its beginning and its end; `on_line` gets all of it.
HEAD_BYTES, TAIL_BYTES = 24 * 1024 * 1024, 8 * 1024 * 1024
LINE_CHARACTERS = 64 * 1024  # what never breaks its line is handed out in pieces
_PREAMBLE_BYTES = 64 * 1024  # what a login shell says before the script; of more only the end is looked at


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
    start = f"printf '{_ENTERED}{mark}\\n' >&2\n".encode() + start
    return RunProgram(READ_PROGRAM.format(size=len(start)), start + lead + text + stdin, mark.encode())


_ENTERED = "shell-"


class _Kept:
    """The first and the last bytes of a stream of any length."""

    def __init__(self) -> None:
        self._head, self._tail = bytearray(), bytearray()
        self.left_out = 0

    def add(self, data: bytes) -> None:
        room = HEAD_BYTES - len(self._head)
        self._head += data[:room]
        self._tail += data[max(0, room) :]
        if len(self._tail) > 2 * TAIL_BYTES:  # not at every piece: it is a copy
            self._trim()

    def _trim(self) -> None:
        excess = len(self._tail) - TAIL_BYTES
        if excess > 0:
            del self._tail[:excess]
            self.left_out += excess

    def text(self) -> str:
        self._trim()
        head, tail = (bytes(part).decode("utf-8", "backslashreplace") for part in (self._head, self._tail))
        return f"{head}\n[{self.left_out} bytes left out]\n{tail}" if self.left_out else head + tail


def _pieces(line: str) -> list[str]:
    """A line as a listener gets it: one, or several of what is too long."""
    return [line[start : start + LINE_CHARACTERS] for start in range(0, len(line), LINE_CHARACTERS)] or [""]


class Streams:
    """Collects both streams of a run and hands out their lines.

    What stands before the mark was said by the login shell's start files or sudo's lecture, and isn't the script's.
    """

    def __init__(self, mark: bytes, on_line: Callable[[str], None] | None) -> None:
        self._mark = mark + b"\n"
        self._entered = False
        self._before = [b"", b""]  # of the mark
        self._kept = (_Kept(), _Kept())
        self._on_line = on_line
        self._decoders = tuple(codecs.getincrementaldecoder("utf-8")("backslashreplace") for _ in range(2))
        self._lines = ["", ""]
        self._marked = [False, False]

    @property
    def entered(self) -> bool:
        """Whether the login shell did what it was asked to."""
        return self._entered or self.marked

    @property
    def marked(self) -> bool:
        """Whether the script came to run."""
        return any(self._marked)

    def feed(self, data: bytes, is_stderr: bool) -> None:
        """Take the next bytes of one stream."""
        if not self._marked[is_stderr]:
            data = self._before[is_stderr] + data
            place = data.find(self._mark)
            while place > 0 and data[:place].endswith(_ENTERED.encode()):
                self._entered = True
                data = data[:place].removesuffix(_ENTERED.encode()) + data[place + len(self._mark) :]
                place = data.find(self._mark)
            if place < 0:
                self._before[is_stderr] = data[-_PREAMBLE_BYTES:]
                return
            self._marked[is_stderr] = True
            data = data[place + len(self._mark) :]
        self._kept[is_stderr].add(data)
        if self._on_line is None:
            return
        lines = (self._lines[is_stderr] + self._decoders[is_stderr].decode(data)).split("\n")
        *told, self._lines[is_stderr] = [piece for line in lines for piece in _pieces(line)]
        for piece in told:
            self._on_line(piece)

    @property
    def last_error(self) -> str:
        """The last thing that was said on standard error; empty: nothing."""
        said = (self._before[1] or self._before[0]).decode("utf-8", "backslashreplace")
        lines = (self._kept[1].text() if self._marked[1] else said).strip().splitlines()
        return lines[-1] if lines else ""

    def output(self, status: int | None, duration_s: float, bound_s: float, lost: str = "") -> Output:
        """The run as an Output. A status that `timeout` gives at the bound counts as cut; `lost` is why the link went."""
        if self._on_line is not None:
            for rest in self._lines:
                if rest:
                    self._on_line(rest)
        if status in (124, 137, 143) and duration_s >= bound_s - 0.05:
            status = None
        stdout, stderr = (kept.text() for kept in self._kept)
        if lost:
            status, stderr = None, f"{stderr}\nthe link went: {lost}".lstrip()
        elif status is None and not stderr:
            stderr = f"no end within {bound_s:g} s"
        return Output(status, stdout, stderr, duration_s, any(kept.left_out for kept in self._kept) or status is None)
