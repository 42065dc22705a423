"""`lupin run` beside a live run: the run's own process is named, kept, or ended first. Supervisor and processes are real."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest

from lupin_cli.run import foreground
from lupin_cli.run.foreground import Occupied, graph_of, run_in_foreground, take_place
from lupin_runtime.stack import supervisor as module
from lupin_runtime.stack.options import Options
from lupin_runtime.stack.readiness import Readiness
from lupin_runtime.stack.runs import Run, RunError, create_run
from lupin_runtime.stack.supervisor import Supervisor
from lupin_runtime.stack.table import ProcessRow, launch
from lupin_runtime.stack.usage import start_ticks
from tests.support.waiting import wait_until

NAV = ProcessRow("nav", command=lambda _: ["-c", "import sys; sys.stdin.read()"], sends_heartbeats=False)
SIM = ProcessRow("sim", command=NAV.command, sends_heartbeats=False, on_death="run", needed_to_drive=True)


class Satisfied:
    """A monitor for which every condition holds."""

    def satisfied(self, _: Readiness) -> bool:
        return True

    def forget(self, _: Readiness) -> None:
        pass

    def explain(self, condition: Readiness) -> str:
        return str(condition)


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Run]:
    """A live run with nav and sim, whose supervisor works in a thread."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setattr(module, "rows", lambda _: (NAV, SIM))
    made, lock = create_run()
    own = {"pid": os.getpid(), "start_ticks": start_ticks(os.getpid())}
    made.write_info({**own, "environment": {"ROS_DOMAIN_ID": "57"}, "options": {"target": "sim"}})
    supervisor = Supervisor(Options(run_path=made.path), made, dict(os.environ), Satisfied())
    ended = threading.Event()

    def work() -> None:
        while not ended.wait(0.02):
            supervisor.step()
            made.write_state({**supervisor.snapshot(), "id": made.id})

    worker = threading.Thread(target=work)
    worker.start()
    wait_until(lambda: all(stage["phase"] == "up" for stage in made.state().get("stages", [{"phase": ""}])), "the run to be up")
    yield made
    ended.set()
    worker.join()
    supervisor.stop()
    os.close(lock)


def stage_of(run: Run, name: str) -> dict[str, Any]:
    return next(stage for stage in run.state()["stages"] if stage["name"] == name)


def test_running_process_is_refused_by_its_pid(run: Run) -> None:
    pid = stage_of(run, "nav")["pid"]
    with pytest.raises(Occupied, match=f"nav already runs in run {run.id}: process {pid}") as refused:
        take_place(run, NAV, replace=False)
    assert refused.value.may_replace
    with pytest.raises(Occupied, match="cannot go on without it") as refused:
        take_place(run, SIM, replace=True)
    assert not refused.value.may_replace
    assert stage_of(run, "nav")["pid"] == pid and stage_of(run, "sim")["pid"]


def test_replaced_process_has_ended_and_comes_back_afterwards(run: Run) -> None:
    pid = stage_of(run, "nav")["pid"]
    claim = take_place(run, NAV, replace=True)
    assert not Path(f"/proc/{pid}").exists() or start_ticks(pid) != stage_of(run, "nav")["start_ticks"]
    with pytest.raises(RunError, match=f"in the foreground, as process {os.getpid()}"):
        take_place(run, NAV, replace=True)
    os.close(claim)
    wait_until(lambda: stage_of(run, "nav")["pid"] not in (None, pid), "the run's own process")


def test_process_that_the_run_lacks_has_one_place(run: Run) -> None:
    slam = ProcessRow("slam", command=NAV.command)
    claim = take_place(run, slam, replace=False)
    with pytest.raises(RunError, match=r"slam of run .* already runs in the foreground"):
        take_place(run, slam, replace=False)
    os.close(claim)


def test_replacement_does_not_wait_forever(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(foreground, "REPLACED_WITHIN_S", 0.2)
    monkeypatch.setattr(module, "holder_of", lambda *_: None)  # a supervisor that does not respond
    with pytest.raises(RunError, match="did not end within 0 s"):
        take_place(run, NAV, replace=True)
    assert stage_of(run, "nav")["pid"]


def test_command_refuses_and_names_the_flag(run: Run) -> None:
    def lupin_run(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "lupin_cli.app", "run", *arguments]
        return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)

    done = lupin_run("nav")
    assert done.returncode == 1 and str(stage_of(run, "nav")["pid"]) in done.stderr
    assert f"lupin run nav --replace --run {run.id}" in done.stderr
    done = lupin_run("sim", "--replace")
    assert done.returncode == 1 and "--replace" not in done.stderr


BEATING = """
import time
from lupin_runtime.ros.supervision import Supervision
supervision = Supervision()
supervision.start()
while True:
    supervision.beat(time.monotonic_ns(), "navigator")
    print("beating", flush=True)
    time.sleep(0.1)
"""


def test_process_that_hangs_is_killed(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    row = ProcessRow("nav", command=lambda _: ["-c", BEATING])
    begun = launch(row, Options())
    ended: list[int] = []
    worker = threading.Thread(target=lambda: ended.append(run_in_foreground(begun, dict(os.environ), tmp_path)))
    worker.start()
    (child,) = wait_until(beating_children, "the process")
    wait_until(lambda: "beating" in capfd.readouterr().out, "its first heartbeat")
    assert not ended
    child.suspend()
    wait_until(lambda: ended, "the end of the process that hangs")
    worker.join()
    assert ended == [-signal.SIGKILL]
    assert "nav did not respond for" in capfd.readouterr().err


def beating_children() -> list[psutil.Process]:
    """Return the children of this process that run BEATING."""
    return [child for child in psutil.Process().children() if BEATING in child.cmdline()]


def test_no_run_is_chosen_among_several(run: Run) -> None:
    _, lock = create_run()
    with pytest.raises(RunError, match=f"several runs are up.*{run.id}"):
        graph_of(None)
    assert graph_of(run.id).run == run
    os.close(lock)
