"""Run one script with standard input and pass on its output as it is printed: the shell's program, and the output's parser."""

from __future__ import annotations

import codecs
import math
import secrets
import shlex
from collections.abc import Callable
from dataclasses import dataclass

from lupin_cli.connection.base import Output
from lupin_cli.connection.batch_protocol import (
    ENVIRONMENT,
    READ_PROGRAM,
    SKIP_PASSWORD,
    TIMEOUT_STATUSES,
    sudo_check,
    sudo_command,
)

# How much of the beginning and of the end of each stream is kept; `on_line` gets all of it.
HEAD_BYTES, TAIL_BYTES = 24 * 1024 * 1024, 8 * 1024 * 1024
LINE_CHARACTERS = 64 * 1024  # longer lines are passed on in pieces
_PREAMBLE_BYTES = 64 * 1024  # of what a login shell prints before the script starts, only the end is kept
_SHELL_MARK_PREFIX = "shell-"


@dataclass(frozen=True)
class RunProgram:
    """A script ready to send: the login shell runs `command` and gets `payload` on standard input.

    The program prints `mark` on both streams once the script starts, as root if that was asked for.
    """

    command: str
    payload: bytes
    mark: bytes


def run_program(script: str, *, root: bool, stdin: bytes, timeout_s: float, sudo_password: str | None) -> RunProgram:
    """Return the program that runs `script` with `stdin`. It is terminated at `timeout_s` even if the connection is lost.

    The shell reads no further than its own text: what follows is the script's standard input, byte for byte.
    """
    mark = f"lupin-{secrets.token_hex(8)}"
    # The script shares its standard input with the shell: `head` takes the text and no byte more.
    text = f"{ENVIRONMENT}printf '{mark}\\n'; printf '{mark}\\n' >&2\n{script}\n".encode("utf-8", "surrogateescape")
    inner = f'eval "$(head -c {len(text)})"'
    timed_command = f"timeout -k 2 {max(1, math.ceil(timeout_s))} /bin/sh -c {shlex.quote(inner)}"
    password_lines = b""
    if root:
        # Already root: no sudo. With a password: sudo may or may not have read the line that holds it.
        after_sudo = shlex.quote(f"{SKIP_PASSWORD}; exec {timed_command}")
        start = (
            f'{ENVIRONMENT}if [ "$(id -u)" = 0 ]; then {SKIP_PASSWORD}; exec {timed_command}; else '
            f"{sudo_check(sudo_password)} || exit 1; exec {sudo_command(sudo_password)} /bin/sh -c {after_sudo}; fi\n"
        ).encode()
        password_lines = (b"" if sudo_password is None else sudo_password.encode() + b"\n") + b"lupin-begins\n"
    else:
        start = f"{ENVIRONMENT}exec {timed_command}\n".encode()
    start = f"printf '{_SHELL_MARK_PREFIX}{mark}\\n' >&2\n".encode() + start
    return RunProgram(READ_PROGRAM.format(size=len(start)), start + password_lines + text + stdin, mark.encode())


class _HeadAndTail:
    """The first and the last bytes of a stream of any length."""

    def __init__(self) -> None:
        self._head, self._tail = bytearray(), bytearray()
        self.omitted = 0

    def add(self, data: bytes) -> None:
        room = HEAD_BYTES - len(self._head)
        self._head += data[:room]
        self._tail += data[max(0, room) :]
        if len(self._tail) > 2 * TAIL_BYTES:  # not after every chunk, because trimming copies
            self._trim()

    def _trim(self) -> None:
        excess = len(self._tail) - TAIL_BYTES
        if excess > 0:
            del self._tail[:excess]
            self.omitted += excess

    def text(self) -> str:
        self._trim()
        head, tail = (bytes(part).decode("utf-8", "backslashreplace") for part in (self._head, self._tail))
        return f"{head}\n[{self.omitted} bytes left out]\n{tail}" if self.omitted else head + tail


def _split_long(line: str) -> list[str]:
    return [line[start : start + LINE_CHARACTERS] for start in range(0, len(line), LINE_CHARACTERS)] or [""]


class OutputCollector:
    """Collects both streams of a run and passes their lines on.

    What comes before the mark was printed by the login shell's startup files or by sudo, not by the script.
    """

    def __init__(self, mark: bytes, on_line: Callable[[str], None] | None) -> None:
        self._mark = mark + b"\n"
        self._shell_started = False
        # Each pair: standard output, standard error.
        self._preamble = [b"", b""]
        self._script_started = [False, False]
        self._kept = (_HeadAndTail(), _HeadAndTail())
        self._decoders = tuple(codecs.getincrementaldecoder("utf-8")("backslashreplace") for _ in range(2))
        self._unfinished_lines = ["", ""]
        self._on_line = on_line

    @property
    def shell_started(self) -> bool:
        """Whether the login shell has run the program."""
        return self._shell_started or self.script_started

    @property
    def script_started(self) -> bool:
        """Whether the script has started, as root if that was asked for."""
        return any(self._script_started)

    def feed(self, data: bytes, is_stderr: bool) -> None:
        """Take the next bytes of one stream."""
        if not self._script_started[is_stderr]:
            data = self._preamble[is_stderr] + data
            start = data.find(self._mark)
            shell_mark = _SHELL_MARK_PREFIX.encode()
            # The shell's mark is its prefix and the script's mark; both may be in this chunk.
            while start > 0 and data[:start].endswith(shell_mark):
                self._shell_started = True
                data = data[:start].removesuffix(shell_mark) + data[start + len(self._mark) :]
                start = data.find(self._mark)
            if start < 0:
                self._preamble[is_stderr] = data[-_PREAMBLE_BYTES:]
                return
            self._script_started[is_stderr] = True
            data = data[start + len(self._mark) :]
        self._kept[is_stderr].add(data)
        if self._on_line is None:
            return
        lines = (self._unfinished_lines[is_stderr] + self._decoders[is_stderr].decode(data)).split("\n")
        *finished, self._unfinished_lines[is_stderr] = [piece for line in lines for piece in _split_long(line)]
        for piece in finished:
            self._on_line(piece)

    @property
    def last_error(self) -> str:
        """The last line of standard error, or an empty string. Before the script starts, standard output serves as well."""
        preamble = (self._preamble[1] or self._preamble[0]).decode("utf-8", "backslashreplace")
        lines = (self._kept[1].text() if self._script_started[1] else preamble).strip().splitlines()
        return lines[-1] if lines else ""

    def output(self, status: int | None, duration_s: float, timeout_s: float, lost: str = "") -> Output:
        """Return the run's Output. `lost` is the reason why the connection was lost.

        A status by which `timeout` reports a terminated script becomes None if `timeout_s` has passed.
        """
        if self._on_line is not None:
            for rest in self._unfinished_lines:
                if rest:
                    self._on_line(rest)
        if status in TIMEOUT_STATUSES and duration_s >= timeout_s - 0.05:
            status = None
        stdout, stderr = (kept.text() for kept in self._kept)
        if lost:
            status, stderr = None, f"{stderr}\nthe link was lost: {lost}".lstrip()
        elif status is None and not stderr:
            stderr = f"did not finish within {timeout_s:g} s"
        return Output(status, stdout, stderr, duration_s, any(kept.omitted for kept in self._kept) or status is None)
