"""A recorded process is signalled only if its PID still belongs to the same process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from lupin_runtime.stack.recorded import RecordedProcess, processes_of, supervisor_of
from lupin_runtime.stack.runs import Run
from lupin_runtime.stack.usage import start_ticks


@pytest.fixture
def child() -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen([sys.executable, "-c", "import signal; signal.pause()"])
    yield process
    process.kill()
    process.wait()


def test_same_process_is_signalled(child: subprocess.Popen[bytes]) -> None:
    assert RecordedProcess("nav", child.pid, start_ticks(child.pid), os.getuid()).signal(signal.SIGKILL)
    assert child.wait(60) == -signal.SIGKILL


@pytest.mark.parametrize("difference", [-1, 1])
def test_other_process_with_its_pid_is_not_signalled(child: subprocess.Popen[bytes], difference: int) -> None:
    ticks = start_ticks(child.pid)
    assert ticks is not None
    assert not RecordedProcess("nav", child.pid, ticks + difference, os.getuid()).signal(signal.SIGKILL)
    assert child.poll() is None


@pytest.mark.parametrize("pid", [-1, 0, 1, True, None, "12", 2.0, [3], 2**40])
def test_damaged_pid_is_never_signalled(pid: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[Any] = []
    monkeypatch.setattr("os.pidfd_open", opened.append)
    ticks = start_ticks(pid) if type(pid) is int else 1
    assert not RecordedProcess("nav", pid, ticks, os.getuid()).signal(signal.SIGKILL)
    assert opened == []


def test_process_of_another_user_is_not_signalled(child: subprocess.Popen[bytes], tmp_path: Path) -> None:
    run = Run(tmp_path)
    run.write_info({"pid": child.pid, "start_ticks": start_ticks(child.pid)})
    run.write_state({"stages": [{"name": "nav", "pid": child.pid, "start_ticks": start_ticks(child.pid)}]})
    assert supervisor_of(run).exists() and processes_of(run)[0].exists()
    # A user's file may name a process of root, and root reads it.
    for process in (supervisor_of(run), *processes_of(run)):
        forged = replace(process, user_id=os.getuid() + 1)
        assert not forged.exists()
        assert not forged.signal(signal.SIGKILL)
    assert child.poll() is None


def test_pid_reused_before_the_signal_is_spared(child: subprocess.Popen[bytes], monkeypatch: pytest.MonkeyPatch) -> None:
    process = RecordedProcess("nav", child.pid, start_ticks(child.pid), os.getuid())
    opened = os.pidfd_open

    def reuse(pid: int) -> int:
        monkeypatch.setattr("lupin_runtime.stack.recorded.start_ticks", lambda _: 1)  # the next owner's start
        return opened(pid)

    monkeypatch.setattr("os.pidfd_open", reuse)
    assert not process.signal(signal.SIGKILL)
    assert child.poll() is None


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give a folder to another user")
def test_run_of_another_user_names_no_own_process(child: subprocess.Popen[bytes], tmp_path: Path) -> None:
    run = Run(tmp_path / "run")
    run.path.mkdir()
    run.write_info({"pid": child.pid, "start_ticks": start_ticks(child.pid)})
    os.chown(run.path, 65534, 65534)
    assert supervisor_of(run).signal(signal.SIGKILL) is False
    assert child.poll() is None


@pytest.mark.parametrize("state", [{}, {"stages": 3}, {"stages": [1, "x", None]}])
def test_damaged_state_names_no_process(tmp_path: Path, state: dict[str, Any]) -> None:
    run = Run(tmp_path)
    run.write_state(state)
    assert processes_of(run) == []
    assert not supervisor_of(run).exists()
