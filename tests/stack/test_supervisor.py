"""The supervisor with real processes and a graph that answers what the test says."""

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

from lupin_runtime import graph
from lupin_runtime.stack import supervisor as module
from lupin_runtime.stack.runs import Run, create_run
from lupin_runtime.stack.sentinels import Heard, Sentinel
from lupin_runtime.stack.supervisor import Phase, Supervisor
from lupin_runtime.stack.table import Options, ProcessRow

STAY = "import sys; sys.stdin.read()"


class ToldWatch:
    """A graph on which exactly the told sentinels hold."""

    def __init__(self) -> None:
        self.holds: set[Sentinel] = set()

    def satisfied(self, sentinel: Sentinel) -> bool:
        return sentinel in self.holds

    def forget(self, sentinel: Sentinel) -> None:
        self.holds.discard(sentinel)

    def explain(self, sentinel: Sentinel) -> str:
        return f"{sentinel}: nobody publishes it"


def row(name: str, code: str, **fields: object) -> ProcessRow:
    return ProcessRow(name, (), when=lambda _: True, command=lambda _: ["-c", code], **fields)  # type: ignore[arg-type]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Run]:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    made, lock = create_run()
    yield made
    os.close(lock)


@pytest.fixture
def supervise(run: Run, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Supervisor]]:
    made: list[Supervisor] = []

    def build(watch: ToldWatch, *table: ProcessRow) -> Supervisor:
        monkeypatch.setattr(module, "rows", lambda _: table)
        made.append(Supervisor(Options(run_path=run.path), run, dict(os.environ), watch))
        return made[-1]

    yield build
    for one in made:
        one.stop()


def until(supervisor: Supervisor, condition: Callable[[], bool], bound_s: float = 10.0) -> None:
    deadline = time.monotonic() + bound_s
    while not condition():
        supervisor.step()
        assert time.monotonic() < deadline, supervisor.snapshot()
        time.sleep(0.02)


def test_a_stage_starts_only_when_what_it_needs_holds_and_says_what_it_waits_for(supervise) -> None:
    watch = ToldWatch()
    scan = Heard(graph.SCAN)
    supervisor = supervise(watch, row("slam", STAY, needs=(scan,)))
    supervisor.step()
    stage = supervisor.stage("slam")
    assert stage is not None and stage.phase is Phase.WAITING and stage.process is None
    assert supervisor.waiting_for(stage) == ["/scan: nobody publishes it"]
    watch.holds.add(scan)
    until(supervisor, lambda: stage.phase is Phase.UP)


def test_a_killed_process_is_restarted_and_named(supervise) -> None:
    supervisor = supervise(ToldWatch(), row("nav", STAY))
    stage = supervisor.stage("nav")
    until(supervisor, lambda: stage.phase is Phase.UP)
    first = stage.process.pid
    os.kill(first, signal.SIGKILL)
    until(supervisor, lambda: bool(supervisor.deaths) and stage.phase is Phase.UP)
    assert stage.process.pid != first
    assert (supervisor.deaths[0].stage, supervisor.deaths[0].status) == ("nav", "ended by SIGKILL")


def test_a_process_that_dies_at_once_is_given_up_after_three_restarts(supervise) -> None:
    supervisor = supervise(ToldWatch(), row("nav", "raise SystemExit(7)", ready=(Heard(graph.MAP),)))
    stage = supervisor.stage("nav")
    until(supervisor, lambda: stage.phase is Phase.FAILED)
    assert stage.restart_count == 3
    assert "status 7" in stage.why and "nav.log" in stage.why
    assert supervisor.stalled() == [stage]


def test_the_death_of_the_robot_ends_the_run_and_is_not_repaired(supervise) -> None:
    supervisor = supervise(ToldWatch(), row("sim", STAY, on_death="run"))
    stage = supervisor.stage("sim")
    until(supervisor, lambda: stage.phase is Phase.UP)
    stage.process.kill()
    until(supervisor, lambda: stage.phase is Phase.FAILED)
    assert "the run ends" in supervisor.deaths[0].consequence


def test_processes_stop_in_rank_order_and_a_deaf_one_is_killed(supervise, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(module, "STOP_GRACE_S", 1.0)
    log = tmp_path / "order"
    ignoring = "import signal, sys; signal.signal(signal.SIGTERM, signal.SIG_IGN)"
    deaf = f"{ignoring}; print('up', flush=True); signal.pause()"
    polite = (
        "import signal, sys\n"
        f"def end(*_):\n    open({str(log)!r}, 'a').write(NAME); sys.exit(0)\n"
        "signal.signal(signal.SIGTERM, end); print('up', flush=True); signal.pause()"
    )
    supervisor = supervise(
        ToldWatch(),
        row("sim", polite.replace("NAME", "'sim '"), stop_rank=3),
        row("nav", polite.replace("NAME", "'nav '")),
        row("deaf", deaf),
    )

    def all_said_up() -> bool:
        logs = list(supervisor.run.logs.glob("*.log"))
        return len(logs) == 3 and all("up" in path.read_text() for path in logs)

    until(supervisor, all_said_up)
    processes = [stage.process for stage in supervisor.stages]
    supervisor.stop()
    assert log.read_text().split() == ["nav", "sim"]
    assert supervisor.stage("deaf").why == "had to be killed"
    assert all(process.returncode is not None for process in processes)


def test_children_end_when_their_supervisor_is_killed() -> None:
    child = "from lupin_runtime.ros.parent import end_with_parent; import signal; end_with_parent(); signal.pause()"
    parent = (
        "import subprocess, sys, time\n"
        f"p = subprocess.Popen([sys.executable, '-c', {child!r}], stdin=subprocess.PIPE, start_new_session=True)\n"
        "print(p.pid, flush=True); time.sleep(60)"
    )
    supervisor = subprocess.Popen([sys.executable, "-c", parent], stdout=subprocess.PIPE, text=True)
    assert supervisor.stdout is not None
    orphan = psutil.Process(int(supervisor.stdout.readline()))
    supervisor.kill()
    supervisor.wait(5.0)
    supervisor.stdout.close()
    psutil.wait_procs([orphan], timeout=10.0)
    assert not orphan.is_running() or orphan.status() == psutil.STATUS_ZOMBIE
