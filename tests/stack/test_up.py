"""`lupin up` as its user and its enemies meet it: interrupted, closed, killed, doubled, with a full /dev/shm."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

pytestmark = [pytest.mark.sim, pytest.mark.graph, pytest.mark.xdist_group("stack")]

BARE = ("--no-slam", "--no-nav2", "--no-twin", "--no-perception", "--no-record", "--no-cameras")
UP_BOUND_S = 60.0


class Up:
    """One `lupin up` in a state folder of the test's own."""

    def __init__(self, home: Path, *arguments: str, prefix: tuple[str, ...] = ()) -> None:
        self.home = home
        environment = {**os.environ, "XDG_STATE_HOME": str(home)}
        command = [*prefix, sys.executable, "-m", "lupin_cli.app", "up", *arguments]
        self.process = subprocess.Popen(
            command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
        )

    def state(self) -> dict:
        for path in (self.home / "lupin" / "runs").glob("*"):
            info = json.loads((path / "run.json").read_text()) if (path / "run.json").exists() else {}
            if info.get("pid") == self.process.pid and (path / "state.json").exists():
                return {**json.loads((path / "state.json").read_text()), "run": info}
        return {}

    def wait_up(self) -> dict:
        deadline = time.monotonic() + UP_BOUND_S
        while time.monotonic() < deadline:
            state = self.state()
            if state.get("stages") and all(stage["phase"] == "up" for stage in state["stages"]):
                return state
            assert self.process.poll() is None, self.process.communicate()
            time.sleep(0.1)
        raise AssertionError(f"not up within {UP_BOUND_S} s: {self.state()}")

    def children(self) -> list[psutil.Process]:
        return [psutil.Process(stage["pid"]) for stage in self.state()["stages"]]

    def end(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        for stream in (self.process.stdout, self.process.stderr):
            if stream is not None:
                stream.close()
        self.process.wait(10.0)


@pytest.fixture
def up(tmp_path: Path) -> Iterator[Callable[..., Up]]:
    made: list[Up] = []

    def start(*arguments: str, prefix: tuple[str, ...] = ()) -> Up:
        made.append(Up(tmp_path, *BARE, *arguments, prefix=prefix))
        return made[-1]

    yield start
    for one in made:
        one.end()


def assert_all_gone(processes: list[psutil.Process], bound_s: float = 12.0) -> None:
    _, alive = psutil.wait_procs(processes, timeout=bound_s)
    assert [p for p in alive if p.is_running() and p.status() != psutil.STATUS_ZOMBIE] == []


def shared_memory() -> set[str]:
    return {path.name for path in Path("/dev/shm").iterdir() if "fastrtps" in path.name or "fastdds" in path.name}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_an_interrupted_run_leaves_no_process_and_no_shared_memory(up, number: int) -> None:
    before = shared_memory()
    run = up("--json")
    run.wait_up()
    children = run.children()
    run.process.send_signal(number)
    out, err = run.process.communicate(timeout=30)
    assert run.process.returncode == 130, err
    assert json.loads(out)["state"] == "INTERRUPTED"
    assert_all_gone(children)
    assert shared_memory() <= before


def test_a_killed_supervisor_takes_every_process_along(up) -> None:
    run = up()
    run.wait_up()
    children = run.children()
    run.process.kill()
    assert_all_gone(children)


def test_two_runs_at_once_have_graphs_of_their_own(up) -> None:
    first, second = up(), up()
    states = [first.wait_up(), second.wait_up()]
    assert len({state["run"]["domain"] for state in states}) == 2
    listing = subprocess.run(
        [sys.executable, "-m", "lupin_cli.app", "down"],
        env={**os.environ, "XDG_STATE_HOME": str(first.home)},
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
    )
    assert listing.returncode == 3 and "--run" in listing.stderr
    done = subprocess.run(
        [sys.executable, "-m", "lupin_cli.app", "down", "--all"],
        env={**os.environ, "XDG_STATE_HOME": str(first.home)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert first.process.wait(10) == second.process.wait(10) == 130


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root: mounts a small /dev/shm of its own")
def test_a_full_dev_shm_does_not_matter(up) -> None:
    fill = 'mount -t tmpfs -o size=64k tmpfs /dev/shm; dd if=/dev/zero of=/dev/shm/full bs=1k 2>/dev/null; exec "$@"'
    run = up(prefix=("unshare", "--mount", "sh", "-c", fill, "sh"))
    run.wait_up()
    full = Path(f"/proc/{run.process.pid}/root/dev/shm/full").stat()
    assert full.st_size == 64 * 1024
    run.process.send_signal(signal.SIGINT)
    assert run.process.wait(30) == 130


def test_a_detached_run_is_seen_by_status_and_ended_by_down(up, tmp_path: Path) -> None:
    environment = {**os.environ, "XDG_STATE_HOME": str(tmp_path)}

    def lupin(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "lupin_cli.app", *arguments],
            env=environment,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )

    begun = lupin("up", "--detach", *BARE)
    assert begun.returncode == 0, begun.stderr
    deadline = time.monotonic() + UP_BOUND_S
    while (status := lupin("status", "--json")).returncode != 0:
        assert time.monotonic() < deadline, status.stdout
    state = json.loads(status.stdout)
    pids = [stage["pid"] for stage in state["stages"]]
    assert lupin("down").returncode == 0
    assert_all_gone([psutil.Process(pid) for pid in pids if psutil.pid_exists(pid)])
    assert lupin("status").returncode == 3
