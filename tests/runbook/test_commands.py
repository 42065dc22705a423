"""`lupin play` and `lupin journal` as they are typed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

LAPTOP = """
vars: {root: {type: text}}
steps:
- name: a file
  on: laptop
  file: {path: "{{ root }}/a", content: "x\\n"}
- name: another by a command
  on: laptop
  command: {run: "touch {{ root }}/b", creates: "{{ root }}/b", reverse: "rm -f {{ root }}/b"}
"""


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    home = tmp_path / "home"
    home.mkdir()
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("XDG_", "LUPIN_CONFIG"))}
    return {**kept, "HOME": str(home)}


@pytest.fixture
def lupin(environment: dict[str, str]) -> Callable[..., subprocess.CompletedProcess[str]]:
    def run(*words: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "lupin_cli.app", *words]
        return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, check=False, stdin=-3)

    return run


Lupin = Callable[..., subprocess.CompletedProcess[str]]


def test_a_run_is_played_looked_up_and_taken_back(lupin: Lupin, written: Callable[..., Path], tmp_path: Path) -> None:
    book, root = str(written(LAPTOP)), f"root={tmp_path}"
    dry = lupin("play", book, "-v", root, "--dry-run", "--diff")
    assert dry.returncode == 0 and "+x" in dry.stderr and "2 of 2 steps would change" in dry.stdout, dry.stderr
    assert not (tmp_path / "a").exists()
    done = lupin("play", book, "-v", root, "--json")
    result = json.loads(done.stdout)
    assert (done.returncode, result["state"], result["changed"]) == (0, "done", 2)
    assert "book: nothing to do" in lupin("play", book, "-v", root).stdout
    listed = json.loads(lupin("journal", "--json").stdout)
    assert [run["state"] for run in listed] == ["done", "done"]
    shown = lupin("journal", "show", result["run"])
    assert shown.returncode == 0 and f"{tmp_path}/a: is written" in shown.stdout
    back = lupin("play", book, "--undo", result["run"], "--yes")
    assert back.returncode == 0 and not (tmp_path / "a").exists() and not (tmp_path / "b").exists(), back.stderr
    assert "takes back" in lupin("journal", "show", "latest").stdout


@pytest.mark.parametrize(
    ("words", "status", "said"),
    [
        ((), 2, "say which playbook"),
        (("deploy-robt",), 2, "there is no playbook 'deploy-robt'; the nearest is 'deploy-robot'"),
        (("sweep", "-v", "machine=moon"), 2, "expected one of laptop, robot, found 'moon'"),
        (("sweep", "-v", "machine"), 2, "given as name=value"),
        (("recover-discovery", "-v", "port=many"), 2, "expected a whole number"),
        (("recover-discovery", "--robot", "127.0.0.1:9"), 3, "127.0.0.1"),
        (("heal", "--undo", "nothing"), 2, "there is no run 'nothing'"),
        (("sweep", "--from", "9"), 2, "there is no step '9'"),
    ],
)
def test_what_can_t_be_played_says_so_in_one_line(words: tuple[str, ...], status: int, said: str, lupin: Lupin) -> None:
    done = lupin("play", *words)
    assert (done.returncode, said in done.stderr) == (status, True), done.stderr
    assert "Traceback" not in done.stderr and done.stdout == ""


def test_a_bad_playbook_is_refused_with_its_place(lupin: Lupin, written: Callable[..., Path]) -> None:
    path = written("steps:\n- name: A\n  symlnk: {path: /a, to: /b}")
    done = lupin("play", str(path))
    assert done.returncode == 2
    assert done.stderr.startswith(f"lupin play: {path}:5:3: ") and "the nearest is 'symlink'" in done.stderr


WAITING = """
vars: {root: {type: text}}
steps:
- name: waits
  on: laptop
  timeout: 100
  command:
    run: "while [ ! -e {{ root }}/go ]; do sleep 0.1; done; touch {{ root }}/b"
    creates: "{{ root }}/b"
    timeout_s: 100
- name: and then
  on: laptop
  file: {path: "{{ root }}/c", content: "x"}
"""


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGKILL, -9)])
def test_a_run_that_is_ended_in_the_middle_is_resumed(
    number: signal.Signals, status: int, lupin: Lupin, environment: dict[str, str], written: Callable[..., Path], tmp_path: Path
) -> None:
    book = str(written(WAITING))
    command = [sys.executable, "-m", "lupin_cli.app", "play", book, "-v", f"root={tmp_path}"]
    with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True) as player:
        assert player.stderr is not None
        said = iter(player.stderr)
        assert any("waits: runs" in line for line in said)  # announced before it is made
        again = lupin("play", book, "--resume")
        assert again.returncode == 1 and "is still going on" in again.stderr
        player.send_signal(number)
        if number == signal.SIGINT:
            assert any("stopping as soon as" in line for line in said)
        (tmp_path / "go").touch()
        assert player.wait(30) == status
    assert not (tmp_path / "c").exists()
    resumed = lupin("play", book, "--resume")
    assert resumed.returncode == 0, resumed.stderr
    assert (tmp_path / "c").exists()
    assert "no run of book was left unfinished" in lupin("play", book, "--resume").stdout


def test_everything_shipped_is_listed(lupin: Lupin) -> None:
    listed = json.loads(lupin("play", "--list", "--json").stdout)
    assert {"sync-clock", "single-home", "deploy-robot"} <= {book["name"] for book in listed}
