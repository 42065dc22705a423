"""`lupin status` without a live run, and while the owner of a run disappears."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from lupin_runtime.stack.runs import Run, create_run
from lupin_runtime.stack.usage import start_ticks

STAGE = {
    "name": "nav",
    "phase": "up",
    "pid": 4242,
    "why": "",
    "waiting_for": [],
    "restarts": 0,
    "up_after_s": 1.0,
    "cpu_percent": 1.0,
    "memory_mb": 10.0,
}


@pytest.fixture(autouse=True)
def state_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))


def status(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "lupin_cli.app", "status", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


def make_run(owner: dict[str, object]) -> tuple[Run, int]:
    run, lock = create_run()
    run.write_info({"options": {"world": "demo", "mission": True}, "started": 1.8e9, **owner})
    run.write_state({"id": run.id, "stages": [STAGE], "age_s": 9.0, "mission": {}})
    return run, lock


def test_status_shows_the_last_result_without_a_live_run() -> None:
    run, lock = make_run({})
    run.write_state({"outcome": {"state": "FAULT", "sentence": "mission FAULT (stuck)", "wall_time_s": 131.0}})
    os.close(lock)
    done = status()
    assert done.returncode == 3
    assert f"run {run.id} in demo" in done.stdout and "fault after 2:11" in done.stdout
    assert done.stdout.count("mission FAULT (stuck)") == 1
    assert "lupin up" in done.stderr and "lupin runs" in done.stderr
    report = json.loads(status("--json").stdout)
    assert (report["runs"], report["last_result"]["state"]) == ([], "FAULT")
    assert run.id in status("--run", run.id[-4:]).stdout


def test_status_never_shows_processes_of_a_killed_supervisor() -> None:
    _run, lock = make_run({})
    os.close(lock)  # as the kernel does it for a process that is killed
    done = status()
    assert done.returncode == 3 and "no result after 0:09" in done.stdout
    assert "nav" not in done.stdout


def test_status_shows_no_state_whose_owner_is_gone() -> None:
    gone = subprocess.Popen(["true"])
    gone.wait()
    _, lock = make_run({"pid": gone.pid, "start_ticks": 1})
    done = status()  # another process holds the lock
    assert done.returncode == 3 and "nav" not in done.stdout
    assert "last_result" in json.loads(status("--json").stdout)
    os.close(lock)


def test_process_that_does_not_respond_is_an_alarm() -> None:
    run, lock = make_run({"pid": os.getpid(), "start_ticks": start_ticks(os.getpid())})
    expected = {"": (0, []), "does not respond": (1, ["nav does not respond"])}
    for trouble, (exit_status, named) in expected.items():
        run.write_state({"id": run.id, "stages": [{**STAGE, "trouble": trouble}], "age_s": 9.0, "mission": {}})
        done = status("--json")
        assert (done.returncode, json.loads(done.stdout)["alarms"]) == (exit_status, named)
    os.close(lock)


def test_watched_run_that_ends_gives_way_to_its_result() -> None:
    holder = (
        "import os, sys, time, json\n"
        "from lupin_runtime.stack.runs import create_run\n"
        "from lupin_runtime.stack.usage import start_ticks\n"
        "run, lock = create_run()\n"
        "run.write_info({'pid': os.getpid(), 'start_ticks': start_ticks(os.getpid())})\n"
        f"run.write_state({{'id': run.id, 'age_s': 1.0, 'stages': [{STAGE!r}]}})\n"
        "print(run.id, flush=True); sys.stdin.read()\n"
    )
    owner = subprocess.Popen([sys.executable, "-c", holder], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert owner.stdin is not None and owner.stdout is not None
    run_id = owner.stdout.readline().strip()
    watcher = subprocess.Popen(
        [sys.executable, "-u", "-m", "lupin_cli.app", "status", "--watch"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    assert json.loads(status("--json").stdout)["id"] == run_id  # it is up
    owner.kill()  # neither an outcome nor a last state
    owner.wait(60)
    out, err = watcher.communicate(timeout=60)
    owner.stdin.close()
    owner.stdout.close()
    assert watcher.returncode == 3, err
    assert "no result after 0:01" in out.splitlines()[-2] + out.splitlines()[-1]
