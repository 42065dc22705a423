"""`lupin up` interrupted, killed, started twice, detached, and with a full disk or a full /dev/shm."""

from __future__ import annotations

import json
import os
import pty
import resource
import select
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.support.waiting import WAIT_S, wait_for_nothing, wait_until

pytestmark = [pytest.mark.sim, pytest.mark.graph, pytest.mark.xdist_group("stack")]

BARE = ("--no-slam", "--no-nav2", "--no-twin", "--no-perception", "--no-record", "--no-cameras")


@pytest.fixture
def up(launch: Callable[..., Any]) -> Callable[..., Any]:
    """Start a run with little more than the robot and its drive bus."""
    return lambda *arguments, **options: launch("--json", *BARE, *arguments, **options)


def gone(processes: list[psutil.Process], timeout_s: float = WAIT_S) -> bool:
    _, alive = psutil.wait_procs(processes, timeout=timeout_s)
    return not [p for p in alive if p.is_running() and p.status() != psutil.STATUS_ZOMBIE]


def shared_memory() -> set[str]:
    return {path.name for path in Path("/dev/shm").iterdir() if "fastrtps" in path.name or "fastdds" in path.name}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_interrupted_run_leaves_no_process_or_shared_memory(up: Callable[..., Any], number: int) -> None:
    before = shared_memory()
    run = up()
    run.wait_up()
    children = run.children()
    run.process.send_signal(number)
    status, result = run.result()
    assert (status, result["state"]) == (130, "INTERRUPTED")
    assert gone(children)
    assert shared_memory() <= before


def test_killed_supervisor_terminates_every_process(up: Callable[..., Any]) -> None:
    run = up()
    run.wait_up()
    children = run.children()
    run.process.kill()
    assert gone(children)


@pytest.mark.long
def test_two_runs_have_separate_graphs(up: Callable[..., Any]) -> None:
    first, second = up(), up()
    states = [first.wait_up(), second.wait_up()]
    assert len({state["run"]["domain"] for state in states}) == 2
    ambiguous = first.lupin("down")
    assert ambiguous.returncode == 3 and "--run" in ambiguous.stderr
    assert first.lupin("down", "--all").returncode == 0
    for run in (first, second):
        assert run.process.wait(WAIT_S) == 130, run.process.communicate()


@pytest.mark.long
@pytest.mark.usefixtures("private_mounts")  # its own small /dev/shm
def test_full_dev_shm_does_not_stop_a_run(up: Callable[..., Any]) -> None:
    fill = 'mount -t tmpfs -o size=64k tmpfs /dev/shm; dd if=/dev/zero of=/dev/shm/full bs=1k 2>/dev/null; exec "$@"'
    run = up(prefix=("unshare", "--mount", "sh", "-c", fill, "sh"))
    run.wait_up()
    full = Path(f"/proc/{run.process.pid}/root/dev/shm/full").stat()
    assert full.st_size == 64 * 1024
    run.process.send_signal(signal.SIGINT)
    assert run.process.wait(WAIT_S) == 130


@pytest.mark.long
def test_full_disk_does_not_end_a_run(up: Callable[..., Any]) -> None:
    run = up()
    state = run.wait_up()
    psutil.Process(run.process.pid).rlimit(psutil.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY))  # every write to a file fails
    killed = run.kill("drive")
    before = (killed, *pids(state))
    run.wait(lambda: [p for p in psutil.Process(run.process.pid).children() if p.pid not in before], "another drive process")
    run.process.send_signal(signal.SIGINT)
    status, result = run.result()
    assert (status, result["state"]) == (130, "INTERRUPTED")


def pids(state: dict[str, Any]) -> list[int]:
    return [stage["pid"] for stage in state["stages"] if stage["pid"] is not None]


def test_killed_drive_process_is_restarted_and_recorded(up: Callable[..., Any]) -> None:
    run = up()
    run.wait_up()
    first = run.kill("drive")
    run.until(
        lambda state: any(s["name"] == "drive" and s["phase"] == "up" and s["pid"] != first for s in state["stages"]),
        "drive bus that is up again",
    )
    assert run.state()["deaths"] == [
        {"stage": "drive", "status": "was killed by SIGKILL", "consequence": "restarted", "ends_run": False}
    ]


def test_run_ends_lost_when_the_simulator_dies(up: Callable[..., Any]) -> None:
    run = up()
    run.wait_up()
    children = run.children()
    run.kill("sim")
    status, result = run.result()
    assert (status, result["state"]) == (1, "LOST")
    assert gone(children)


def test_invalid_layout_is_a_usage_error(launch: Callable[..., Any], tmp_path: Path) -> None:
    layout = tmp_path / "broken.json"
    layout.write_text('{"units": "m", "tables": {"A": {"x0": 0, "x1": 1, "y0": 0}}, "tags": {}}')
    run = launch(*BARE, "--world", str(layout))
    out, err = run.process.communicate(timeout=60)
    assert run.process.returncode == 2, out
    assert "broken.json" in err and "y1" in err


def test_detached_run_is_shown_by_status_and_stopped_by_down(launch: Callable[..., Any]) -> None:
    run = launch("--detach", *BARE)
    out, err = run.process.communicate(timeout=60)
    assert run.process.returncode == 0, err
    assert "lupin down" in out
    wait_until(lambda: run.lupin("status", "--json").returncode == 0, "a run that is up")
    state = json.loads(run.lupin("status", "--json").stdout)
    assert {stage["phase"] for stage in state["stages"]} == {"up"}
    processes = [psutil.Process(stage["pid"]) for stage in state["stages"]]
    assert run.lupin("down").returncode == 0
    assert gone(processes)
    assert run.lupin("status").returncode == 3


def test_hung_process_is_replaced_and_its_death_is_recorded(up: Callable[..., Any]) -> None:
    run = up()
    run.wait_up()
    pid = run.stage("body")["pid"]
    os.kill(pid, signal.SIGSTOP)
    state = run.until(lambda state: state["deaths"] and all(stage["phase"] == "up" for stage in state["stages"]), "replacement")
    death = state["deaths"][0]
    assert death["stage"] == "body" and death["status"].startswith("did not respond for ")
    assert run.stage("body")["pid"] != pid
    run.wait(lambda: run.lupin("status").returncode == 0, "status without an alarm")


@pytest.mark.long
def test_hung_supervisor_is_named_by_status_and_stopped_by_down(launch: Callable[..., Any]) -> None:
    run = launch(*BARE)
    run.wait_up()
    children = run.children()
    stopped = run.children()[0]
    run.process.send_signal(signal.SIGSTOP)
    stopped.send_signal(signal.SIGSTOP)
    run.wait(lambda: "supervisor has not responded" in run.lupin("status").stdout, "alarm")
    assert run.lupin("status").returncode == 1
    down = run.lupin("down")
    assert down.returncode == 0, down.stdout + down.stderr
    run.process.wait(WAIT_S)
    assert gone(children)


@pytest.mark.long
def test_suspended_run_continues_without_replacing_anything(up: Callable[..., Any]) -> None:
    run = up()
    run.wait_up()
    everything = [psutil.Process(run.process.pid), *run.children()]
    for process in everything:
        process.suspend()
    wait_for_nothing(4.0, "a replacement of silent processes, by a supervisor that is suspended too")
    for process in everything:
        process.resume()
    run.wait(lambda: run.lupin("status").returncode == 0, "status without an alarm")
    wait_for_nothing(3.0, "a replacement, which would begin within 2 s")
    assert run.state()["deaths"] == []
    assert run.lupin("status").returncode == 0


@pytest.mark.long
def test_closed_terminal_leaves_a_result_and_a_report(tmp_path: Path) -> None:
    pid, master = pty.fork()
    if pid == 0:  # a session of its own, whose terminal is the other end
        os.environ.update(XDG_STATE_HOME=str(tmp_path))
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
        arguments = [option for option in BARE if option != "--no-record"]
        os.execv(sys.executable, [sys.executable, "-m", "lupin_cli.app", "up", "--no-web", "--no-joystick", *arguments])
    try:
        printed = b""
        while b"READY" not in printed:
            printed += os.read(master, 4096)
        for _ in range(25):  # some seconds are recorded; the terminal must be read meanwhile
            wait_for_nothing(0.2, "a report of a recording that is not empty")
            if select.select([master], [], [], 0)[0]:
                os.read(master, 65536)
    finally:
        os.close(master)
        _, status = os.waitpid(pid, 0)
    assert os.waitstatus_to_exitcode(status) == 130
    (run,) = (tmp_path / "lupin" / "runs").iterdir()
    assert json.loads((run / "result.json").read_text())["state"] == "INTERRUPTED"
    assert (run / "report" / "report.html").exists()
