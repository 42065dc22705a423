"""Printing of text that comes from elsewhere: from a robot, a network or a file.

A terminal obeys escape sequences, so all such text must pass through `printable` before a person sees it, usually in `echo`.
JSON does not need this: it escapes control characters itself.
"""

from __future__ import annotations

import contextlib
import errno
import os
import re
import shutil
import signal
import sys
import textwrap
import threading
import time
from collections.abc import Callable, Iterator
from typing import TextIO

import typer

# All control characters (ASCII's, DEL and the C1 set, in which U+009B begins a sequence) except tabs and line feeds, and those
# that end a line or change the direction of writing, by which a text can look like another.
_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")
_ERASE_LINE = "\r\x1b[K"
_BAR_WIDTH = 20
WORK_LINE_S = 2.0


def printable(text: str) -> str:
    """Replace each control character except tabs and line breaks by U+FFFD."""
    return _CONTROL.sub("\N{REPLACEMENT CHARACTER}", text.replace("\r\n", "\n"))


def echo(message: object = "", *, err: bool = False, nl: bool = True, wrap: bool = True) -> None:
    """Print `message` without control characters on standard output, or on standard error with `err`.

    A terminal gets line breaks between words, because its own come in the middle of a word; with `wrap` false, it gets none.
    """
    text = printable(str(message))
    stream = sys.stderr if err else sys.stdout
    if wrap and stream.isatty():
        text = wrapped(text, shutil.get_terminal_size().columns)
    typer.echo(text, err=err, nl=nl)


def confirm(question: str) -> bool:
    """Ask a person a yes-or-no question on standard error, without its control characters; no is the default."""
    return typer.confirm(printable(question), default=False, err=True)


def wrapped(text: str, columns: int, label: re.Pattern[str] | None = None) -> str:
    """Break the lines of `text` between words so that they fit; continued lines are indented as their first, plus two.

    A `label` at the start of a line is never separated from its text, which is continued below itself. A word that is longer
    than a line is left whole, such as a path or a URL, which a break would spoil.
    """
    lines = []
    for line in text.split("\n"):
        if len(line) <= columns:
            lines.append(line)
            continue
        first = line[: len(line) - len(line.lstrip())]
        following = f"{first}  "
        if label is not None and (found := label.match(line)):
            first = found[0]
            following = " " * len(first)
        lines += textwrap.wrap(
            line[len(first) :],
            width=max(columns, 20),
            initial_indent=first,
            subsequent_indent=following,
            break_long_words=False,
            break_on_hyphens=False,
            replace_whitespace=False,
        )
    return "\n".join(lines)


def minutes(seconds: float) -> str:
    """Return a duration as m:ss, or h:mm:ss from an hour on."""
    whole = int(seconds)
    hours, rest = divmod(whole, 3600)
    return f"{hours}:{rest // 60:02d}:{rest % 60:02d}" if hours else f"{rest // 60}:{rest % 60:02d}"


@contextlib.contextmanager
def timed_progress() -> Iterator[Callable[[str], None]]:
    """Yield a function that prints a line of progress on standard error with the elapsed time.

    On a terminal, a counter below it shows that the work goes on until the next line comes.
    """
    start, done, lock = time.monotonic(), threading.Event(), threading.Lock()
    live = can_repaint(sys.stderr)

    def show(text: str) -> None:
        with lock:
            if live:
                erase_status_line()
            echo(f"[{time.monotonic() - start:5.0f} s] {text}", err=True)

    def count() -> None:
        while not done.wait(1.0):
            with lock:
                print(f"{_ERASE_LINE}[{time.monotonic() - start:5.0f} s] …", end="", file=sys.stderr, flush=True)

    counter = threading.Thread(target=count, name="lupin-progress", daemon=True)
    if live:
        counter.start()
    try:
        yield show
    finally:
        done.set()
        if live:
            counter.join()
            erase_status_line()


def can_repaint(stream: TextIO) -> bool:
    """Return whether a line on this stream can be erased and written again: it is a terminal, and no dumb one."""
    return stream.isatty() and os.environ.get("TERM", "dumb") not in ("dumb", "unknown")


@contextlib.contextmanager
def work_progress() -> Iterator[Callable[[str, float | None], None]]:
    """Yield a function that says on standard error what is being done now, and which share of it is done, 0 to 1, if known.

    Work of less than a second shows nothing. A terminal shows one line, which is erased at the end; other outputs get a line
    every WORK_LINE_S.
    """
    lock, done = threading.Lock(), threading.Event()
    start = time.monotonic()
    live = can_repaint(sys.stderr)
    now: tuple[str, float | None] = ("", None)

    def show(text: str, share: float | None = None) -> None:
        nonlocal now
        with lock:
            now = (text, share)

    def repaint() -> None:
        printed_s = start
        while not done.wait(0.2):
            with lock:
                text, share = now
            at_s = time.monotonic()
            if text and live and at_s - start >= 1.0:
                show_status_line(progress_text(text, share, at_s - start))
            elif text and not live and at_s - printed_s >= WORK_LINE_S:
                printed_s = at_s
                echo(progress_text(text, share, at_s - start), err=True)

    painter = threading.Thread(target=repaint, name="lupin-progress", daemon=True)
    painter.start()
    try:
        yield show
    finally:
        done.set()
        painter.join()
        if live:
            erase_status_line()


def progress_text(text: str, share: float | None, elapsed_s: float) -> str:
    """Return a line of progress: what is done, a bar and percents if the share is known, the time that it has taken."""
    if share is None:
        return f"{text}  {minutes(elapsed_s)}"
    share = min(1.0, max(0.0, share))
    filled = round(share * _BAR_WIDTH)
    return f"{text}  {'━' * filled}{'─' * (_BAR_WIDTH - filled)} {100 * share:3.0f} %  {minutes(elapsed_s)}"


class _DroppingStream:
    """A text stream that drops what is written once its reader is gone; everything else is the stream's."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        try:
            return self._stream.write(text)  # raises TypeError for bytes, by which click tells the kinds of streams apart
        except OSError as error:
            self._drop(error)
            return len(text)

    def flush(self) -> None:
        try:
            self._stream.flush()
        except OSError as error:
            self._drop(error)

    def _drop(self, error: OSError) -> None:
        if error.errno not in (errno.EIO, errno.EPIPE):  # the terminal was closed, the pipe's reader has ended
            raise error
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, self._stream.fileno())
        os.close(null)

    def __getattr__(self, name: str) -> object:
        return getattr(self._stream, name)


@contextlib.contextmanager
def output_may_vanish() -> Iterator[None]:
    """Let the block finish its work when its terminal is closed, or the reader of its pipe ends: its output is dropped.

    A hang-up signal whose handler the block does not set itself has no effect.
    """
    handler = signal.getsignal(signal.SIGHUP)
    if handler is signal.SIG_DFL:
        signal.signal(signal.SIGHUP, lambda *_: None)  # not SIG_IGN, which child processes would inherit
    streams = _DroppingStream(sys.stdout), _DroppingStream(sys.stderr)
    try:
        with contextlib.redirect_stdout(streams[0]), contextlib.redirect_stderr(streams[1]):
            yield
    finally:
        if handler is signal.SIG_DFL:
            signal.signal(signal.SIGHUP, handler)


@contextlib.contextmanager
def sigterm_as_ctrl_c() -> Iterator[None]:
    """Treat SIGTERM like Ctrl-C in the block, which then ends in order."""

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextlib.contextmanager
def ending_in_order() -> Iterator[None]:
    """Keep a block that plays a playbook from being killed halfway, with the robot's stack stopped.

    It goes on without a terminal that is closed, or an SSH session that is lost; SIGTERM stops it like Ctrl-C.
    """
    with output_may_vanish(), sigterm_as_ctrl_c():
        yield


def is_interrupt(error: BaseException) -> bool:
    """Return whether an exception came of Ctrl-C: one that hits a lock's release makes threading raise its own instead."""
    seen: BaseException | None = error
    while seen is not None and not isinstance(seen, KeyboardInterrupt):
        seen = seen.__context__
    return seen is not None


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


def show_status_line(text: str) -> None:
    """Replace the line that the cursor is on by `text`, cut to the terminal's width."""
    columns = shutil.get_terminal_size().columns
    print(f"{_ERASE_LINE}{printable(text)[: columns - 1]}", end="", file=sys.stderr, flush=True)


def erase_status_line() -> None:
    """Erase the line that the cursor is on, to make room for a question; a dumb terminal begins a new one."""
    print(_ERASE_LINE if can_repaint(sys.stderr) else "\n", end="", file=sys.stderr, flush=True)
