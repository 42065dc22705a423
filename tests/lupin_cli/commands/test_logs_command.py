"""`lupin logs -f` while logs grow and are truncated, and a process starts late."""

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
def end_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], Run]]:
    """Create a run that is up; yield a function that ends it."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    created, lock = create_run()
    (created.logs / "nav.log").write_text("first\n")
    open_locks = [lock]

    def end() -> Run:
        os.close(open_locks.pop())
        return created

    yield end
    for descriptor in open_locks:
        os.close(descriptor)


def test_follow_shows_every_line_of_a_truncated_log(tmp_path: Path, end_run: Callable[[], Run]) -> None:
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
        end_run()
        assert lines.get(timeout=TIMEOUT_S) == "nav          the last line"
        assert child.wait(TIMEOUT_S) == 0
    finally:
        child.kill()
        child.wait(TIMEOUT_S)
        reader.join(TIMEOUT_S)
        child.stdout.close()
