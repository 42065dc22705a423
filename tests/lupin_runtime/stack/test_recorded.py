"""A recorded process is signalled only if its PID still belongs to the same process."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
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
    assert RecordedProcess("nav", child.pid, start_ticks(child.pid)).signal(signal.SIGKILL)
    assert child.wait(10) == -signal.SIGKILL


@pytest.mark.parametrize("difference", [-1, 1])
def test_other_process_with_its_pid_is_not_signalled(child: subprocess.Popen[bytes], difference: int) -> None:
    ticks = start_ticks(child.pid)
    assert ticks is not None
    assert not RecordedProcess("nav", child.pid, ticks + difference).signal(signal.SIGKILL)
    assert child.poll() is None


@pytest.mark.parametrize("pid", [-1, 0, 1, True, None, "12", 2.0, [3], 2**40])
def test_damaged_pid_is_never_signalled(pid: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[tuple[int, int]] = []
    monkeypatch.setattr("os.kill", lambda *arguments: sent.append(arguments))
    ticks = start_ticks(pid) if type(pid) is int else 1
    assert not RecordedProcess("nav", pid, ticks).signal(signal.SIGKILL)
    assert sent == []


@pytest.mark.parametrize("state", [{}, {"stages": 3}, {"stages": [1, "x", None]}])
def test_damaged_state_names_no_process(tmp_path: Path, state: dict[str, Any]) -> None:
    run = Run(tmp_path)
    run.write_state(state)
    assert processes_of(run) == []
    assert not supervisor_of(run).exists()
