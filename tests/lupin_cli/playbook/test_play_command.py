"""`lupin play` and `lupin journal` on the command line."""

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
- name: write a file
  on: laptop
  file: {path: "{{ root }}/a", content: "x\\n"}
- name: make another one with a command
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


def test_play_journal_and_undo_from_the_command_line(lupin: Lupin, write_playbook: Callable[..., Path], tmp_path: Path) -> None:
    playbook, root = str(write_playbook(LAPTOP)), f"root={tmp_path}"
    dry = lupin("play", playbook, "-v", root, "--dry-run", "--diff")
    assert dry.returncode == 0 and "+x" in dry.stdout and "2 of 2 steps would change" in dry.stdout, dry.stderr
    assert not (tmp_path / "a").exists()
    done = lupin("play", playbook, "-v", root, "--json")
    result = json.loads(done.stdout)
    assert (done.returncode, result["state"], result["changed"]) == (0, "done", 2)
    assert "book: nothing to do" in lupin("play", playbook, "-v", root).stdout
    listed = json.loads(lupin("journal", "--json").stdout)
    assert [run["state"] for run in listed] == ["done", "done"]
    shown = lupin("journal", "show", result["run"])
    assert shown.returncode == 0 and f"create {tmp_path}/a" in shown.stdout
    back = lupin("play", playbook, "--undo", result["run"], "--yes")
    assert back.returncode == 0 and not (tmp_path / "a").exists() and not (tmp_path / "b").exists(), back.stderr
    assert "undoes" in lupin("journal", "show", "latest").stdout


@pytest.mark.parametrize(
    ("words", "status", "expected"),
    [
        ((), 2, "name a playbook"),
        (("deploy-robt",), 2, "there is no playbook 'deploy-robt'; did you mean 'deploy-robot'"),
        (("sweep", "-v", "machine=moon"), 2, "expected one of laptop, robot, found 'moon'"),
        (("sweep", "-v", "machine"), 2, "given as name=value"),
        (("recover-discovery", "-v", "port=many"), 2, "expected a whole number"),
        (("recover-discovery", "--robot", "127.0.0.1:9"), 3, "127.0.0.1"),
        (("heal", "--undo", "nothing"), 2, "no run has 'nothing' in its id"),
        (("sweep", "--from", "9"), 2, "there is no step '9'"),
    ],
)
def test_usage_errors_are_one_line(words: tuple[str, ...], status: int, expected: str, lupin: Lupin) -> None:
    done = lupin("play", *words)
    assert (done.returncode, expected in done.stderr) == (status, True), done.stderr
    assert "Traceback" not in done.stderr and done.stdout == ""


def test_bad_playbook_is_refused_with_its_place(lupin: Lupin, write_playbook: Callable[..., Path]) -> None:
    path = write_playbook("steps:\n- name: A\n  symlnk: {path: /a, to: /b}")
    done = lupin("play", str(path))
    assert done.returncode == 2
    assert done.stderr.startswith(f"lupin play: {path}:5:3: ") and "did you mean 'symlink'" in done.stderr


WAITING = """
vars: {root: {type: text}}
steps:
- name: wait for the operator
  on: laptop
  timeout: 100
  command:
    run: "while [ ! -e {{ root }}/go ]; do sleep 0.1; done; touch {{ root }}/b"
    creates: "{{ root }}/b"
    timeout_s: 100
- name: write a file
  on: laptop
  file: {path: "{{ root }}/c", content: "x"}
"""


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGKILL, -9)])
def test_interrupted_and_killed_runs_are_resumed(
    number: signal.Signals,
    status: int,
    lupin: Lupin,
    environment: dict[str, str],
    write_playbook: Callable[..., Path],
    tmp_path: Path,
) -> None:
    playbook = str(write_playbook(WAITING))
    command = [sys.executable, "-m", "lupin_cli.app", "play", playbook, "-v", f"root={tmp_path}"]
    with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True) as player:
        assert player.stderr is not None
        lines = iter(player.stderr)
        assert any("wait for the operator: run" in line for line in lines)  # announced before the change
        again = lupin("play", playbook, "--resume")
        assert again.returncode == 1 and "is still going on" in again.stderr
        player.send_signal(number)
        if number == signal.SIGINT:
            assert any("stopping after the current step" in line for line in lines)
        (tmp_path / "go").touch()
        assert player.wait(60) == status
    assert not (tmp_path / "c").exists()
    resumed = lupin("play", playbook, "--resume")
    assert resumed.returncode == 0, resumed.stderr
    assert (tmp_path / "c").exists()
    assert "there is no unfinished run of book" in lupin("play", playbook, "--resume").stdout


def test_list_of_a_playbook_names_its_steps(lupin: Lupin) -> None:
    steps = json.loads(lupin("play", "deploy-robot", "--list", "--json").stdout)["steps"]
    assert [step["number"] for step in steps] == list(range(1, len(steps) + 1))
    (release,) = [step for step in steps if step["name"] == "Install the release"]
    assert (release["tags"], release["machine"]) == (["release"], "robot")
    shown = lupin("play", "single-home", "--list").stdout
    assert " 5 Reboot the robot without its access point  [reboot on robot]  asks first" in shown, shown


def test_list_names_the_shipped_playbooks(lupin: Lupin) -> None:
    listed = json.loads(lupin("play", "--list", "--json").stdout)
    assert {"sync-clock", "single-home", "deploy-robot"} <= {playbook["name"] for playbook in listed}


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--undo", "latest", "--tag", "cameras"), "--undo undoes all steps of a run; it excludes --tag"),
        (("--undo", "latest", "--resume", "--from", "2"), "it excludes --resume, --from"),
        (("--resume", "--from", "2", "--tag", "x"), "the steps that it began with; it excludes --from, --tag"),
        (("--force",), "--force needs --undo"),
    ],
)
def test_options_without_effect_are_usage_errors(words: tuple[str, ...], expected: str, lupin: Lupin) -> None:
    done = lupin("play", "deploy-robot", "--yes", *words)
    assert (done.returncode, expected in done.stderr) == (2, True), done.stderr
