"""A program that is not ours, run beside ours."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

SLEEPER = "import os, sys, time; open(sys.argv[1], 'w').write(str(os.getpid())); time.sleep(60)"


def until(condition: Callable[[], object], what: str, bound_s: float = 20.0) -> None:
    deadline = time.monotonic() + bound_s
    while not condition():
        assert time.monotonic() < deadline, what
        time.sleep(0.02)


def gone(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


@pytest.fixture
def external() -> Iterator[Callable[..., subprocess.Popen[bytes]]]:
    """Start a program through lupin_runtime.stack.external."""
    made: list[subprocess.Popen[bytes]] = []

    def start(*command: str) -> subprocess.Popen[bytes]:
        arguments = [sys.executable, "-m", "lupin_runtime.stack.external", *command]
        made.append(subprocess.Popen(arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE))
        return made[-1]

    yield start
    for one in made:
        one.kill()
        one.communicate()


@pytest.mark.parametrize("end", ["terminate", "kill", "input"])
def test_the_program_ends_with_the_process_that_runs_it(external, tmp_path: Path, end: str) -> None:
    note = tmp_path / "pid"
    wrapper = external(sys.executable, "-c", SLEEPER, str(note))
    until(lambda: note.exists() and note.read_text(), "start of the program")
    pid = int(note.read_text())
    if end == "input":
        wrapper.stdin.close()
        wrapper.stdin = None
    else:
        getattr(wrapper, end)()
    until(lambda: gone(pid), "end of the program")


def test_a_program_that_its_user_closes_is_not_started_again(external) -> None:
    wrapper = external(sys.executable, "-c", "raise SystemExit(3)")
    assert b"has ended with status 3" in wrapper.stdout.readline()
    assert wrapper.poll() is None
    os.kill(wrapper.pid, signal.SIGTERM)
    assert wrapper.wait(10.0) == 0
