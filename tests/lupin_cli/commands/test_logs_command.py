"""`lupin logs -f` while logs grow, are shortened, and a process starts late."""

from __future__ import annotations

import os
import queue
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

import pytest

from lupin_runtime.stack.runs import Run, create_run

TIMEOUT_S = 60.0


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], Run]]:
    """A run that is up; calling it again ends it."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    made, lock = create_run()
    (made.logs / "nav.log").write_text("first\n")
    held = [lock]

    def end() -> Run:
        os.close(held.pop())
        return made

    yield end
    for descriptor in held:
        os.close(descriptor)


def test_follow_shows_every_line_also_after_the_log_was_shortened(tmp_path: Path, run: Callable[[], Run]) -> None:
    command = [sys.executable, "-u", "-m", "lupin_cli.app", "logs", "-f"]
    child = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    lines: queue.Queue[str] = queue.Queue()

    def read(output: IO[str]) -> None:
        for line in output:
            lines.put(line.rstrip())

    reader = threading.Thread(target=read, args=(child.stdout,))
    reader.start()
    try:
        (nav,) = tmp_path.glob("lupin/runs/*/logs/nav.log")
        assert lines.get(timeout=TIMEOUT_S) == "nav          first"
        with nav.open("a") as log:
            log.write("second, a longer line\nthi")
            log.flush()
            assert lines.get(timeout=TIMEOUT_S) == "nav          second, a longer line"
            log.write("rd\n")
        assert lines.get(timeout=TIMEOUT_S) == "nav          third"
        nav.write_text("after\n")  # as the supervisor does with a log that is too long
        assert lines.get(timeout=TIMEOUT_S) == "nav          after"
        (nav.parent / "twin.log").write_text("late\n")
        assert lines.get(timeout=TIMEOUT_S) == "twin         late"
        with nav.open("a") as log:
            log.write("the last line\n")
        run()
        assert lines.get(timeout=TIMEOUT_S) == "nav          the last line"
        assert child.wait(TIMEOUT_S) == 0
    finally:
        child.kill()
        child.wait(TIMEOUT_S)
        reader.join(TIMEOUT_S)
        child.stdout.close()
