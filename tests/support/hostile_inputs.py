"""Hostile inputs by number: a valid file of some kind is damaged, and what reads it is called as a person would call it.

An input is repeated by its number: `LUPIN_HOSTILE_ONLY=1234 pytest tests/lupin_cli/test_hostile_inputs.py`.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import random
import resource
import shlex
import shutil
import signal
import sys
import traceback
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from unittest import mock

from lupin_cli import app
from lupin_cli.exit_codes import INTERNAL_ERROR
from lupin_cli.printed_commands import repeat_inventory
from lupin_cli.terminal import printable
from tests.support.hostile_kinds import KINDS, Kind
from tests.support.mutations import HOSTILE_TEXTS, damage, replace_by_special_file

CPU_LIMIT_S = 5.0  # of this process: other work on the machine does not count
HANG_LIMIT_S = 60.0
MEMORY_LIMIT_BYTES = 4 << 30  # of addresses, beyond what this process has
_SPECIAL_SHARE = 0.06


class TookTooLong(BaseException):
    """An input used more processor time than any may, or waits for something that never comes."""


@dataclass
class HostileInput:
    """One input in its folder. `run` returns what is wrong with how Lupin handles it; empty if nothing is."""

    number: int
    kind: Kind
    folder: Path
    words: tuple[str, ...] = ()
    special: str = ""
    before: dict[Path, bytes] = field(default_factory=dict)
    status: int | str | None = 0
    printed: str = ""

    def __str__(self) -> str:
        what = f"lupin {shlex.join(self.words)}" if self.words else f"reading the {self.kind.name}"
        repeat = f"LUPIN_HOSTILE_ONLY={self.number} .venv/bin/python -m pytest tests/lupin_cli/test_hostile_inputs.py"
        return f"{self.kind.name}{f' ({self.special})' if self.special else ''}: {what[:300]}\n  repeat: {repeat}"

    def run(self) -> str:
        """Call the command or the reader; return the first thing that is wrong."""
        output = io.TextIOWrapper(io.BytesIO(), "utf-8", errors="backslashreplace", write_through=True)
        problem = ""
        try:
            with _environment(self.folder), _limited(), mock.patch.multiple(sys, stdout=output, stderr=output):
                problem = self._read() if self.kind.read else self._call()
        except TookTooLong as error:
            problem = f"took too long: {error}"
        self.printed = text = output.buffer.getvalue().decode("utf-8", "replace")
        if not problem and "Traceback (most recent call last)" in text:
            problem = f"printed a traceback:\n{text[-1500:]}"
        if not problem and text.replace("\r\n", "\n") != printable(text):
            problem = f"printed control characters: {text[:200]!r}"
        return problem or self._lost_file()

    def _call(self) -> str:
        try:
            with mock.patch.object(sys, "argv", ["lupin", "--debug", *self.words]):
                app.main()
        except SystemExit as error:
            self.status = error.code
            return f"ended with status {INTERNAL_ERROR}" if error.code == INTERNAL_ERROR else ""
        except Exception as error:
            # Without --debug, an OSError that no command has caught ends with its message, which explains a long name.
            too_long = isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG
            return "" if too_long else _last_lines(traceback.format_exc())
        finally:
            repeat_inventory(None)
        return ""

    def _read(self) -> str:
        assert self.kind.read is not None
        try:
            self.kind.read(self.folder)
        except self.kind.expected as error:
            return "" if str(error) else f"an error without a message: {error!r}"
        except Exception:
            return _last_lines(traceback.format_exc())
        return ""

    def _lost_file(self) -> str:
        if self.kind.changes:
            return ""
        after = set(_contents(self.folder).values())
        lost = [str(path) for path, content in self.before.items() if content not in after]
        return f"lost the content of {', '.join(lost)}" if lost else ""


def valid_inputs(work: Path) -> Iterator[HostileInput]:
    """Make the valid files of every kind, in a folder of its own for each command that reads them."""
    for kind in KINDS:
        for number, words in enumerate(kind.commands or [()]):
            if kind.targets:
                folder = work / f"{kind.name}-{number}"
                folder.mkdir(parents=True)
                kind.write(folder)
                yield HostileInput(number, kind, folder, words, "", _contents(folder))


def hostile_input(number: int, work: Path) -> HostileInput:
    """Make the input of this number in a folder of its own below `work`."""
    dice = random.Random(number)
    kind = dice.choices(KINDS, [each.weight for each in KINDS])[0]
    template = work / "templates" / kind.name
    if not template.exists():
        template.mkdir(parents=True)
        kind.write(template)
    folder = work / f"input-{number}"
    shutil.copytree(template, folder, symlinks=True)
    special = ""
    if kind.targets:
        target = next(folder.glob(dice.choice(kind.targets)))
        if dice.random() < _SPECIAL_SHARE:
            special = replace_by_special_file(target, dice)
        else:
            target.write_bytes(damage(target.read_bytes(), dice))
    else:
        os.mkfifo(folder / "fifo")
    words = dice.choice(kind.commands) if kind.commands else ()
    words = tuple(word.replace("{}", _argument(dice)) for word in words)
    return HostileInput(number, kind, folder, words, special, _contents(folder))


def _argument(dice: random.Random) -> str:
    """Return an argument that a shell can pass: without NUL."""
    own = ("fifo", "sample.yaml", ".", "/", "map.yaml", "picture.png", "latest", "-", "--", "x,y", "1,2,3", "nan,nan", "a=b")
    chosen = dice.choice(own) if dice.random() < 0.3 else dice.choice(HOSTILE_TEXTS)
    return chosen.replace("\0", "?")


def _contents(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file() and not path.is_symlink()}


@contextlib.contextmanager
def _environment(folder: Path) -> Iterator[None]:
    """Work in the folder, which is also the home of all of Lupin's files."""
    variables = {"HOME": "home", "XDG_STATE_HOME": "state", "XDG_CONFIG_HOME": "config", "XDG_CACHE_HOME": "cache"}
    values = {name: str(folder / value) for name, value in variables.items()}
    before = Path.cwd()
    os.chdir(folder)
    try:
        with mock.patch.dict(os.environ, {**values, "SHELL": "/bin/bash", "COLUMNS": "120"}):
            for name in ("LUPIN_CONFIG", "DISPLAY", "WAYLAND_DISPLAY", "ROS_DISCOVERY_SERVER"):
                os.environ.pop(name, None)
            yield
    finally:
        os.chdir(before)


@contextlib.contextmanager
def _limited() -> Iterator[None]:
    """Raise TookTooLong in the block after CPU_LIMIT_S of processor time, or HANG_LIMIT_S."""

    def end(number: int, _frame: object) -> None:
        raise TookTooLong(f"{CPU_LIMIT_S:g} s of processor time" if number == signal.SIGPROF else f"{HANG_LIMIT_S:g} s")

    handlers = {number: signal.signal(number, end) for number in (signal.SIGPROF, signal.SIGALRM)}
    signal.setitimer(signal.ITIMER_PROF, CPU_LIMIT_S)
    signal.setitimer(signal.ITIMER_REAL, HANG_LIMIT_S)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    limits = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY_LIMIT_BYTES, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, limits)
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in handlers.items():
            signal.signal(number, handler)


def _last_lines(text: str) -> str:
    return "\n".join(text.rstrip().splitlines()[-14:])
