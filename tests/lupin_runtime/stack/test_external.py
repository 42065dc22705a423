"""Third-party programs as processes of the stack."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.support.waiting import wait_until

SLEEPER = "import os, sys, time; open(sys.argv[1], 'w').write(str(os.getpid())); time.sleep(60)"


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
def test_external_program_exits_with_its_wrapper(external: Any, tmp_path: Path, end: str) -> None:
    note = tmp_path / "pid"
    wrapper = external(sys.executable, "-c", SLEEPER, str(note))
    wait_until(lambda: note.exists() and note.read_text(), "start of the program")
    pid = int(note.read_text())
    if end == "input":
        wrapper.stdin.close()
        wrapper.stdin = None
    else:
        getattr(wrapper, end)()
    wait_until(lambda: gone(pid), "end of the program")


def test_closed_external_program_is_not_restarted(external: Any) -> None:
    wrapper = external(sys.executable, "-c", "raise SystemExit(3)")
    assert b"exited with status 3" in wrapper.stdout.readline()
    assert wrapper.poll() is None
    os.kill(wrapper.pid, signal.SIGTERM)
    assert wrapper.wait(60) == 0
