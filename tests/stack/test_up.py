"""`lupin up` as its user and its enemies meet it: interrupted, closed, killed, doubled, with a full /dev/shm."""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pytest

pytestmark = [pytest.mark.sim, pytest.mark.graph, pytest.mark.xdist_group("stack")]

BARE = ("--no-slam", "--no-nav2", "--no-twin", "--no-perception", "--no-record", "--no-cameras")


@pytest.fixture
def up(launch: Callable[..., Any]) -> Callable[..., Any]:
    """A run with little more than the robot and its drive bus."""
    return lambda *arguments, **options: launch("--json", *BARE, *arguments, **options)


def gone(processes: list[psutil.Process], bound_s: float = 12.0) -> bool:
    _, alive = psutil.wait_procs(processes, timeout=bound_s)
    return not [p for p in alive if p.is_running() and p.status() != psutil.STATUS_ZOMBIE]


def shared_memory() -> set[str]:
    return {path.name for path in Path("/dev/shm").iterdir() if "fastrtps" in path.name or "fastdds" in path.name}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_an_interrupted_run_leaves_no_process_and_no_shared_memory(up, number: int) -> None:
    before = shared_memory()
    run = up()
    run.wait_up()
    children = run.children()
    run.process.send_signal(number)
    status, result = run.result()
    assert (status, result["state"]) == (130, "INTERRUPTED")
    assert gone(children)
    assert shared_memory() <= before


def test_a_killed_supervisor_takes_every_process_along(up) -> None:
    run = up()
    run.wait_up()
    children = run.children()
    run.process.kill()
    assert gone(children)


def test_two_runs_at_once_have_graphs_of_their_own(up) -> None:
    first, second = up(), up()
    states = [first.wait_up(), second.wait_up()]
    assert len({state["run"]["domain"] for state in states}) == 2
    ambiguous = first.lupin("down")
    assert ambiguous.returncode == 3 and "--run" in ambiguous.stderr
    assert first.lupin("down", "--all").returncode == 0
    assert first.process.wait(10) == second.process.wait(10) == 130


@pytest.mark.usefixtures("own_mounts")  # a small /dev/shm of its own
def test_a_full_dev_shm_does_not_matter(up) -> None:
    fill = 'mount -t tmpfs -o size=64k tmpfs /dev/shm; dd if=/dev/zero of=/dev/shm/full bs=1k 2>/dev/null; exec "$@"'
    run = up(prefix=("unshare", "--mount", "sh", "-c", fill, "sh"))
    run.wait_up()
    full = Path(f"/proc/{run.process.pid}/root/dev/shm/full").stat()
    assert full.st_size == 64 * 1024
    run.process.send_signal(signal.SIGINT)
    assert run.process.wait(30) == 130


def test_a_process_that_is_killed_comes_back_and_is_named(up) -> None:
    run = up()
    run.wait_up()
    first = run.kill("drive")
    run.until(
        lambda state: any(s["name"] == "drive" and s["phase"] == "up" and s["pid"] != first for s in state["stages"]),
        "drive bus that is up again",
    )
    assert run.state()["deaths"] == [{"stage": "drive", "status": "ended by SIGKILL", "consequence": "restarted"}]


def test_the_end_of_the_robot_is_the_end_of_the_run_and_says_so(up) -> None:
    run = up()
    run.wait_up()
    children = run.children()
    run.kill("sim")
    status, result = run.result()
    assert (status, result["state"]) == (1, "LOST")
    assert gone(children)


def test_a_stage_that_never_comes_up_is_named_with_what_it_waits_for(launch, tmp_path: Path) -> None:
    layout = tmp_path / "broken.json"
    layout.write_text('{"units": "m", "tables": {"A": {"x0": 0, "x1": 1, "y0": 0}}, "tags": {}}')
    run = launch(*BARE, "--world", str(layout))
    out, err = run.process.communicate(timeout=60)
    assert run.process.returncode == 2, out
    assert "broken.json" in err and "y1" in err


def test_a_detached_run_is_seen_by_status_and_ended_by_down(launch, tmp_path: Path) -> None:
    run = launch("--detach", *BARE)
    out, err = run.process.communicate(timeout=60)
    assert run.process.returncode == 0, err
    assert "lupin down" in out
    deadline = time.monotonic() + 60.0
    while (status := run.lupin("status", "--json")).returncode != 0:
        assert time.monotonic() < deadline, status.stdout
    state = json.loads(status.stdout)
    assert {stage["phase"] for stage in state["stages"]} == {"up"}
    processes = [psutil.Process(stage["pid"]) for stage in state["stages"]]
    assert run.lupin("down").returncode == 0
    assert gone(processes)
    assert run.lupin("status").returncode == 3
