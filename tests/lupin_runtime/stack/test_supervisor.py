"""The supervisor with real processes and a fake graph monitor."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest

from lupin_runtime import graph
from lupin_runtime.stack import supervisor as module
from lupin_runtime.stack.options import Options
from lupin_runtime.stack.readiness import Readiness, TopicSample
from lupin_runtime.stack.runs import Run, RunError, create_run
from lupin_runtime.stack.service import failure
from lupin_runtime.stack.stage import LIVENESS_FAILED, Phase
from lupin_runtime.stack.supervisor import Supervisor
from lupin_runtime.stack.table import ProcessRow
from lupin_runtime.stack.takeover import claim_place, holder_of
from tests.support.waiting import WAIT_S, wait_for_nothing, wait_until

STAY = "import sys; sys.stdin.read()"


class FakeMonitor:
    """A monitor for which exactly the conditions in `holds` hold."""

    def __init__(self) -> None:
        self.holds: set[Readiness] = set()

    def satisfied(self, condition: Readiness) -> bool:
        return condition in self.holds

    def forget(self, condition: Readiness) -> None:
        self.holds.discard(condition)

    def explain(self, condition: Readiness) -> str:
        return f"{condition}: no publisher"


def row(name: str, code: str, **fields: object) -> ProcessRow:
    fields = {"sends_heartbeats": "Supervision" in code, **fields}
    return ProcessRow(name, command=lambda _: ["-c", code], **fields)  # type: ignore[arg-type]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Run]:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    made, lock = create_run()
    yield made
    os.close(lock)


@pytest.fixture
def supervise(run: Run, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Supervisor]]:
    made: list[Supervisor] = []

    def build(watch: FakeMonitor, *table: ProcessRow) -> Supervisor:
        monkeypatch.setattr(module, "rows", lambda _: table)
        made.append(Supervisor(Options(run_path=run.path), run, dict(os.environ), watch))
        return made[-1]

    yield build
    for one in made:
        one.stop()


def until(supervisor: Supervisor, condition: Callable[[], bool]) -> None:
    wait_until(condition, lambda: str(supervisor.snapshot()), interval_s=0.02, each=supervisor.step)


def test_stage_waits_for_its_needs_and_names_them(supervise: Any) -> None:
    watch = FakeMonitor()
    scan = TopicSample(graph.SCAN)
    supervisor = supervise(watch, row("slam", STAY, needs=(scan,)))
    supervisor.step()
    stage = supervisor.stage("slam")
    assert stage is not None and stage.phase is Phase.WAITING and stage.process is None
    assert supervisor.waiting_for(stage) == ["/scan: no publisher"]
    watch.holds.add(scan)
    until(supervisor, lambda: stage.phase is Phase.UP)


def test_files_of_a_process_are_for_its_user_only(supervise: Any, run: Run) -> None:
    write = f"from pathlib import Path; Path({str(run.path / 'written')!r}).write_text('x'); print('y', flush=True)\n"
    supervisor = supervise(FakeMonitor(), row("recorder", write + STAY))
    stage = supervisor.stage("recorder")
    log = run.logs / "recorder.log"
    until(supervisor, lambda: stage.phase is Phase.UP and (run.path / "written").exists() and log.read_bytes() != b"")
    modes = {path.name: path.stat().st_mode & 0o777 for path in run.path.rglob("*")}
    assert (modes["written"], modes["recorder.log"], modes["processes"]) == (0o600, 0o600, 0o700)


def test_process_is_restarted_while_no_file_can_be_written(supervise: Any, run: Run) -> None:
    supervisor = supervise(FakeMonitor(), row("drive", STAY))
    stage = supervisor.stage("drive")
    until(supervisor, lambda: stage.phase is Phase.UP)
    first = stage.process.pid
    for folder in (run.logs, run.path / "processes"):
        shutil.rmtree(folder)
        folder.touch()  # nobody, not even root, can write below a file
    os.kill(first, signal.SIGKILL)
    until(supervisor, lambda: bool(supervisor.deaths) and stage.phase is Phase.UP)
    assert stage.process.pid != first and stage.process.poll() is None


def test_killed_process_is_restarted_and_reported(supervise: Any) -> None:
    supervisor = supervise(FakeMonitor(), row("nav", STAY))
    stage = supervisor.stage("nav")
    until(supervisor, lambda: stage.phase is Phase.UP)
    first = stage.process.pid
    os.kill(first, signal.SIGKILL)
    until(supervisor, lambda: bool(supervisor.deaths) and stage.phase is Phase.UP)
    assert stage.process.pid != first
    assert (supervisor.deaths[0].stage, supervisor.deaths[0].status) == ("nav", "was killed by SIGKILL")


def test_process_that_keeps_dying_gets_three_restarts(supervise: Any) -> None:
    supervisor = supervise(FakeMonitor(), row("nav", "raise SystemExit(7)", ready=(TopicSample(graph.MAP),)))
    stage = supervisor.stage("nav")
    until(supervisor, lambda: stage.phase is Phase.FAILED)
    assert stage.restart_count == 3
    assert "status 7" in stage.why and "nav.log" in stage.why
    assert supervisor.stalled() == [stage]
    assert [death.ends_run for death in supervisor.deaths] == [False, False, False, True]


def test_only_what_was_up_is_restarted_at_any_later_time(supervise: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "RESTARTS_WITHIN_S", 0.0)  # as if each attempt took longer
    watch, scan = FakeMonitor(), TopicSample(graph.SCAN)
    watch.holds.add(scan)
    never_up = row("nav", "raise SystemExit(7)", ready=(TopicSample(graph.MAP),))
    supervisor = supervise(watch, never_up, row("slam", STAY, ready=(scan,)))
    nav, slam = supervisor.stages
    until(supervisor, lambda: nav.phase is Phase.FAILED)
    assert nav.restart_count == 3 and "given up after 3 restarts without being up" in nav.why
    while slam.restart_count < 5:
        until(supervisor, lambda: slam.phase is Phase.UP)
        slam.process.kill()
        until(supervisor, lambda: slam.phase is Phase.STARTING)
        watch.holds.add(scan)
    assert "slam" not in [death.stage for death in supervisor.deaths if death.ends_run]


def test_run_continues_without_an_optional_process(supervise: Any) -> None:
    unable = row("console", "raise SystemExit(7)", ready=(TopicSample(graph.MAP),), optional=True)
    supervisor = supervise(FakeMonitor(), unable, row("nav", STAY))
    stage = supervisor.stage("console")
    until(supervisor, lambda: stage.phase is Phase.FAILED)
    until(supervisor, supervisor.all_up)
    assert supervisor.stalled() == [] and not any(death.ends_run for death in supervisor.deaths)
    assert "console" not in supervisor.liveness.motion_block_reasons()


def test_optional_process_is_started_again_after_it_was_given_up(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    table = (row("joystick", "raise SystemExit(7)", optional=True), row("drive", STAY))
    monkeypatch.setattr(module, "rows", lambda _: table)
    supervisor = Supervisor(Options(run_path=run.path), run, dict(os.environ), FakeMonitor(), retry_optional_s=1.0)
    try:
        stage = supervisor.stage("joystick")
        assert stage is not None
        until(supervisor, lambda: stage.phase is Phase.FAILED)
        assert "it is started again in 1 s" in stage.why
        given_up, failed_s = stage.restart_count, time.monotonic()
        until(supervisor, lambda: stage.restart_count > given_up)
        assert time.monotonic() - failed_s >= 0.9
        until(supervisor, lambda: stage.phase is Phase.FAILED)
        assert not any(death.ends_run for death in supervisor.deaths)
    finally:
        supervisor.stop()


def test_death_of_the_simulator_stops_the_run(supervise: Any) -> None:
    supervisor = supervise(FakeMonitor(), row("sim", STAY, on_death="run"))
    stage = supervisor.stage("sim")
    until(supervisor, lambda: stage.phase is Phase.UP)
    stage.process.kill()
    until(supervisor, lambda: stage.phase is Phase.FAILED)
    assert "the run was stopped" in supervisor.deaths[0].consequence and supervisor.deaths[0].ends_run


def test_processes_stop_by_rank_and_a_stuck_one_is_killed(
    supervise: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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
        FakeMonitor(),
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
    assert supervisor.stage("deaf").why == "killed: it did not stop in time"
    assert all(process.returncode is not None for process in processes)


BEATING = (
    "import time; from lupin_runtime.ros.supervision import Supervision\n"
    "channel = Supervision(); channel.start()\n"
    "while True:\n    channel.beat(STAMP, 'node'); print(channel.motion_hold(), flush=True); time.sleep(0.1)"
)
ALIVE = BEATING.replace("STAMP", "time.monotonic_ns()")
STUCK = BEATING.replace("STAMP", "START").replace("import time;", "import time; START = time.monotonic_ns();")


def test_optional_process_that_was_given_up_blocks_no_motion(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    dying = ALIVE.replace("while True:", "for _ in range(3):")
    table = (row("joystick", dying, optional=True), row("drive", ALIVE, commands_motion=True))
    monkeypatch.setattr(module, "rows", lambda _: table)
    monkeypatch.setattr(module, "RESTARTS_ALLOWED", 0)
    supervisor = Supervisor(Options(run_path=run.path), run, dict(os.environ), FakeMonitor(), retry_optional_s=0.1)
    reasons: list[str] = []
    try:
        stage = supervisor.stage("joystick")
        assert stage is not None
        until(supervisor, lambda: stage.restart_count == 1)

        def has_died_again() -> bool:
            reasons.append(supervisor.liveness.motion_block_reasons().get("joystick", ""))
            return stage.restart_count == 3

        until(supervisor, has_died_again)
    finally:
        supervisor.stop()
    assert set(reasons) == {""}


def test_stopped_process_blocks_motion_and_is_replaced(supervise: Any) -> None:
    supervisor = supervise(FakeMonitor(), row("twin", ALIVE), row("drive", ALIVE, commands_motion=True))
    stage = supervisor.stage("twin")
    until(supervisor, lambda: supervisor.liveness.responds("twin") and supervisor.liveness.responds("drive"))
    first = stage.process.pid
    os.kill(first, signal.SIGSTOP)
    until(supervisor, lambda: supervisor.liveness.motion_block_reasons() == {"twin": "does not respond"})
    assert supervisor.snapshot()["stages"][0]["trouble"] == "does not respond"
    until(supervisor, lambda: bool(supervisor.deaths))
    assert re.match(r"did not respond for \d+\.\d s \(node node\)", supervisor.deaths[0].status)
    until(supervisor, lambda: stage.process.pid != first and not supervisor.liveness.motion_block_reasons())

    def received_holds() -> list[str]:
        lines = (supervisor.run.logs / "drive.log").read_text().splitlines()
        return [line for line, before in zip(lines, [None, *lines]) if line != before]

    until(supervisor, lambda: received_holds()[-1] == "")
    assert received_holds()[:2] == ["", "twin does not respond"]
    assert {*received_holds()[2:-1]} <= {"twin has exited", "twin is being restarted"}


def test_hung_node_is_replaced_although_its_process_sends_beats(supervise: Any) -> None:
    supervisor = supervise(FakeMonitor(), row("nav", STUCK))
    until(supervisor, lambda: bool(supervisor.deaths))
    assert "did not respond" in supervisor.deaths[0].status


def test_up_process_without_any_heartbeat_is_replaced(supervise: Any) -> None:
    supervisor = supervise(FakeMonitor(), row("body", STAY, sends_heartbeats=True))
    until(supervisor, lambda: bool(supervisor.deaths))
    assert re.match(r"did not respond for \d+\.\d s", supervisor.deaths[0].status)


def test_process_without_heartbeats_is_never_silent(supervise: Any) -> None:
    supervisor = supervise(FakeMonitor(), row("rviz", STAY))
    stage = supervisor.stage("rviz")
    until(supervisor, lambda: stage.phase is Phase.UP)
    os.kill(stage.process.pid, signal.SIGSTOP)
    deadline = time.monotonic() + 3.0
    until(supervisor, lambda: time.monotonic() > deadline)
    assert supervisor.deaths == [] and supervisor.liveness.motion_block_reasons() == {}


def test_hung_main_loop_of_supervisor_blocks_motion(supervise: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lupin_runtime.stack.liveness.MAIN_LOOP_S", 0.3)
    supervisor = supervise(FakeMonitor(), row("drive", ALIVE, commands_motion=True))
    until(supervisor, lambda: supervisor.liveness.responds("drive"))
    log = supervisor.run.logs / "drive.log"
    wait_until(lambda: "the supervisor's main loop does not respond" in log.read_text(), log.read_text)  # without any step


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_failed_heartbeat_thread_ends_the_run(supervise: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    supervisor = supervise(FakeMonitor(), row("drive", ALIVE, commands_motion=True))
    until(supervisor, lambda: supervisor.liveness.responds("drive"))
    assert failure(supervisor) == ""
    monkeypatch.setattr(supervisor.liveness, "_judge", lambda _: 1 / 0)
    until(supervisor, lambda: bool(supervisor.deaths))
    assert supervisor.deaths == [LIVENESS_FAILED] and LIVENESS_FAILED.ends_run
    assert failure(supervisor) == "supervisor can no longer receive heartbeats"
    supervisor.step()
    assert len(supervisor.deaths) == 1
    log = supervisor.run.logs / "drive.log"
    wait_until(lambda: "the supervisor does not respond" in log.read_text(), log.read_text)


def test_process_above_its_memory_limit_is_replaced(supervise: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "USAGE_PERIOD_S", 0.1)
    supervisor = supervise(FakeMonitor(), row("slam", f"data = bytearray(80_000_000); {STAY}", memory_max_mb=50))
    until(supervisor, lambda: bool(supervisor.deaths))
    status = supervisor.deaths[0].status
    assert status.startswith("used ") and status.endswith(" MB, its limit is 50 MB, and was killed")
    assert supervisor.deaths[0].consequence == "restarted"


def test_memory_of_children_counts_toward_the_limit(supervise: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "USAGE_PERIOD_S", 0.1)
    child = f"data = bytearray(80_000_000); {STAY}"
    code = f"import subprocess, sys\nsubprocess.run([sys.executable, '-c', {child!r}], stdin=0, start_new_session=True)"
    supervisor = supervise(FakeMonitor(), row("rviz", code, memory_max_mb=60))
    until(supervisor, lambda: bool(supervisor.deaths))
    assert supervisor.deaths[0].status.endswith(" MB, its limit is 60 MB, and was killed")


def test_replacement_that_does_not_come_up_is_replaced_again(supervise: Any) -> None:
    watch = FakeMonitor()
    ready = TopicSample(graph.SCAN)
    watch.holds.add(ready)
    supervisor = supervise(watch, row("slam", STAY, ready=(ready,), up_within_s=0.5))
    until(supervisor, lambda: supervisor.stages[0].phase is Phase.UP)
    os.kill(supervisor.stages[0].process.pid, signal.SIGKILL)
    until(supervisor, lambda: len(supervisor.deaths) == 2)
    assert supervisor.deaths[1].status == "was not up again within 0.5 s and was killed"
    watch.holds.add(ready)
    until(supervisor, lambda: supervisor.stages[0].phase is Phase.UP)


def test_long_log_is_shortened_while_its_process_writes(supervise: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "USAGE_PERIOD_S", 0.1)
    monkeypatch.setattr(module, "LOG_MAX_BYTES", 10_000)
    chatter = "import time, itertools\nfor n in itertools.count():\n    print(n, 'x' * 100, flush=True); time.sleep(0.001)"
    supervisor = supervise(FakeMonitor(), row("nav", chatter))
    log = supervisor.run.logs / "nav.log"
    until(supervisor, lambda: (log.parent / "nav.log.1").exists())
    until(supervisor, lambda: log.stat().st_size > 1000)
    deadline = time.monotonic() + 2.0
    until(supervisor, lambda: time.monotonic() > deadline)
    assert log.stat().st_size < 500_000
    assert log.read_bytes().count(b"\0") == 0


def test_child_exits_if_a_killed_supervisor_left_beats_unread() -> None:
    parent = (
        "import socket, subprocess, sys, time\n"
        "channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)\n"
        f"p = subprocess.Popen([sys.executable, '-c', {ALIVE!r}], stdin=theirs.fileno(), stdout=2, start_new_session=True)\n"
        "theirs.close(); channel.recv(100); print(p.pid, flush=True); time.sleep(60)"
    )
    supervisor = subprocess.Popen([sys.executable, "-c", parent], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert supervisor.stdout is not None
    orphan = psutil.Process(int(supervisor.stdout.readline()))
    wait_for_nothing(0.5, "an answer to the heartbeats that the child sends meanwhile")
    supervisor.kill()
    supervisor.wait(WAIT_S)
    supervisor.stdout.close()
    psutil.wait_procs([orphan], timeout=WAIT_S)
    assert not orphan.is_running() or orphan.status() == psutil.STATUS_ZOMBIE


def test_children_exit_when_their_supervisor_is_killed() -> None:
    child = "from lupin_runtime.ros.supervision import end_with_parent; import signal; end_with_parent(); signal.pause()"
    parent = (
        "import subprocess, sys, time\n"
        f"p = subprocess.Popen([sys.executable, '-c', {child!r}], stdin=subprocess.PIPE, start_new_session=True)\n"
        "print(p.pid, flush=True); time.sleep(60)"
    )
    supervisor = subprocess.Popen([sys.executable, "-c", parent], stdout=subprocess.PIPE, text=True)
    assert supervisor.stdout is not None
    orphan = psutil.Process(int(supervisor.stdout.readline()))
    supervisor.kill()
    supervisor.wait(WAIT_S)
    supervisor.stdout.close()
    psutil.wait_procs([orphan], timeout=WAIT_S)
    assert not orphan.is_running() or orphan.status() == psutil.STATUS_ZOMBIE


ENDS_ORDERLY = (
    "import signal, sys\n"
    "def end(*_):\n    print('ended orderly', flush=True); sys.exit(0)\n"
    "signal.signal(signal.SIGTERM, end); print('up', flush=True); signal.pause()"
)


def test_claimed_place_is_left_to_its_holder_and_taken_back(supervise: Any, run: Run) -> None:
    watch, ready = FakeMonitor(), TopicSample(graph.MAP)
    watch.holds.add(ready)
    supervisor = supervise(watch, row("nav", ENDS_ORDERLY, ready=(ready,)))
    stage, log = supervisor.stage("nav"), run.logs / "nav.log"
    until(supervisor, lambda: stage.phase is Phase.UP and "up" in log.read_text())
    own = stage.process
    claim = claim_place(run, "nav")
    with pytest.raises(RunError, match=f"nav of run {run.id} already runs in the foreground, as process {os.getpid()}"):
        claim_place(run, "nav")
    until(supervisor, lambda: own.poll() is not None and stage.process is None)
    assert "ended orderly" in log.read_text()
    assert stage.phase is Phase.STARTING, "what was observed of its own process does not count for the other"
    assert supervisor.snapshot()["stages"][0]["pid"] is None and str(os.getpid()) in stage.why
    watch.holds.add(ready)  # the holder's process works
    until(supervisor, lambda: stage.phase is Phase.UP)
    assert supervisor.deaths == [] and supervisor.stalled() == [] and supervisor.liveness.motion_block_reasons() == {}
    os.close(claim)
    until(supervisor, lambda: stage.phase is Phase.UP and stage.process is not None)
    assert stage.process.pid != own.pid and stage.why == "" and stage.restart_count == 0


def test_claim_ends_with_the_process_that_holds_it(run: Run) -> None:
    code = (
        "import sys; from lupin_runtime.stack.takeover import claim_place; from lupin_runtime.stack.runs import Run\n"
        "from pathlib import Path\n"
        "claim_place(Run(Path(sys.argv[1])), 'nav'); print('held', flush=True); sys.stdin.read()"
    )
    command = [sys.executable, "-c", code, str(run.path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout is not None and holder.stdout.readline() == "held\n"
        assert holder_of(run, "nav") == holder.pid
        holder.kill()
    assert holder_of(run, "nav") is None
    (run.path / "processes" / "nav.claim").write_text("rubbish")
    assert holder_of(run, "nav") is None and holder_of(run, "slam") is None


def test_process_without_which_nothing_stops_keeps_its_place(supervise: Any, run: Run) -> None:
    supervisor = supervise(FakeMonitor(), row("drive", STAY, needed_to_drive=True), row("sim", STAY, on_death="run"))
    until(supervisor, supervisor.all_up)
    claims = [claim_place(run, name) for name in ("drive", "sim")]
    pids = [stage.process.pid for stage in supervisor.stages]
    for _ in range(5):
        supervisor.step()
    assert [stage.process.pid for stage in supervisor.stages] == pids and supervisor.all_up()
    for claim in claims:
        os.close(claim)
