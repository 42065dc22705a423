"""`lupin logs -f` while logs grow and are truncated, and a process starts late."""

from __future__ import annotations

import json
import os
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

import pytest

from lupin_runtime.stack.runs import Run, create_run

TIMEOUT_S = 60.0
LINE = f"{'':21}{{}}  {{}}"  # without time and level


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
        assert lines.get(timeout=TIMEOUT_S) == LINE.format("nav", "first")
        with nav.open("a") as log:
            log.write("second, a longer line\nthi")
            log.flush()
            assert lines.get(timeout=TIMEOUT_S) == LINE.format("nav", "second, a longer line")
            log.write("rd\n")
        assert lines.get(timeout=TIMEOUT_S) == LINE.format("nav", "third")
        nav.write_text("after\n")  # as the supervisor does with a log that is too long
        assert lines.get(timeout=TIMEOUT_S) == LINE.format("nav", "after")
        (nav.parent / "twin.log").write_text("late\n")
        assert lines.get(timeout=TIMEOUT_S) == LINE.format("twin", "late")
        with nav.open("a") as log:
            log.write("the last line\n")
        end_run()
        assert lines.get(timeout=TIMEOUT_S) == LINE.format("nav", "the last line")
        assert child.wait(TIMEOUT_S) == 0
    finally:
        child.kill()
        child.wait(TIMEOUT_S)
        reader.join(TIMEOUT_S)
        child.stdout.close()


def lupin_logs(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "lupin_cli.app", "logs", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)


@pytest.fixture
def two_logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An ended run whose processes wrote in turn; one ended with a stack trace."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setenv("TZ", "UTC")
    run, lock = create_run()
    os.close(lock)
    (run.logs / "nav.log").write_text(
        "[INFO] [1795515361.498342132] [bt_navigator]: first\n"
        "[ERROR] [1795515363.500000000] [bt_navigator]: third\n"
        "Traceback (most recent call last):\nValueError: no path"
    )
    (run.logs / "slam.log").write_text("[WARN] [1795515362.250000000] [slam_toolbox]: second \x1b]0;owned\x07\n")


@pytest.mark.usefixtures("two_logs")
def test_logs_are_merged_by_time_with_their_levels() -> None:
    done = lupin_logs()
    assert done.returncode == 0, done.stderr
    day = "" if time.strftime("%m-%d", time.gmtime()) == "11-24" else "11-24 "
    assert done.stdout.splitlines() == [
        f"{day}10:16:01.498  info   nav   bt_navigator: first",
        f"{day}10:16:02.250  warn   slam  slam_toolbox: second \ufffd]0;owned",
        f"{day}10:16:03.500  error  nav   bt_navigator: third",
        f"{'':21}nav   Traceback (most recent call last):",
        f"{'':21}nav   ValueError: no path",
    ]


@pytest.mark.usefixtures("two_logs")
def test_level_keeps_the_stack_trace_of_an_error() -> None:
    rows = json.loads(lupin_logs("--level", "error", "--json").stdout)
    assert [(row["process"], row["level"], row["text"]) for row in rows] == [
        ("nav", "error", "third"),
        ("nav", "error", "Traceback (most recent call last):"),
        ("nav", "error", "ValueError: no path"),
    ]
    assert [row["text"] for row in json.loads(lupin_logs("-n", "1", "--json").stdout)] == ["ValueError: no path"]


@pytest.mark.usefixtures("two_logs")
@pytest.mark.parametrize(
    ("arguments", "status", "text"),
    [
        (("--level", "loud"), 2, "none of: debug, info, warn, error, fatal"),
        (("--json", "-f"), 2, "excludes --follow"),
        (("mars",), 2, "it has: nav, slam"),
        (("--run", "zz"), 3, "no run has 'zz' in its id"),
    ],
)
def test_wrong_use_of_logs_names_what_is_right(arguments: tuple[str, ...], status: int, text: str) -> None:
    done = lupin_logs(*arguments)
    assert (done.returncode, text in done.stderr) == (status, True), done.stderr
