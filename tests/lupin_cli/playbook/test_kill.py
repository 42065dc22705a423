"""SIGKILL at every point of a run: resume continues it, and undo restores the state before the first attempt."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from lupin_cli.connection.local import LocalTarget
from lupin_cli.playbook import Playbook, find_playbook_run, load, play
from lupin_cli.playbook.run_record import list_runs
from lupin_cli.playbook.undo import undo
from tests.support import play_and_die
from tests.support.waiting import wait_until

BOOK = """
vars: {root: {type: text}}
steps:
- name: change a file
  file: {path: "{{ root }}/kept", content: "new\\n", mode: "0600"}
- name: add a line
  as: line
  line-in-file: {path: "{{ root }}/kept", line: "more"}
- name: link to it if the line is new
  when: line.changed
  symlink: {path: "{{ root }}/link", to: kept}
- name: take some time
  command: {run: "sleep 0.05; touch {{ root }}/slow", creates: "{{ root }}/slow", reverse: "rm -f {{ root }}/slow"}
"""


def files_in(root: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in sorted(root.iterdir())}


def kill_and_resume(playbook: Playbook, folder: Path, at: int, after: bool) -> bool:
    """Kill the run at the journal line `at`, resume and undo it. Returns False if the run has no such line."""
    root, journal = folder / "machine", folder / "journal"
    root.mkdir(parents=True)
    (root / "kept").write_text("old\n")
    victim = [sys.executable, play_and_die.__file__, playbook.file, str(root), str(journal), str(at)]
    done = subprocess.run([*victim, "after" if after else "before"], timeout=60, check=False)
    target = {"robot": LocalTarget("robot")}
    if done.returncode == 0:
        assert files_in(root) == {"kept": "new\nmore\n", "link": "new\nmore\n", "slow": ""}
        return False
    assert done.returncode == -9
    runs = list_runs(journal)
    if not runs:  # killed before its first line: nothing was changed, and there is nothing to resume
        assert files_in(root) == {"kept": "old\n"}
        assert play(playbook, target, {"root": str(root)}, journal=journal).state == "done"
    elif runs[0].state == "cut off":
        again = play(playbook, target, resume=True, journal=journal)
        assert (again.state, again.run) == ("done", runs[0].run), again.message
    assert files_in(root) == {"kept": "new\nmore\n", "link": "new\nmore\n", "slow": ""}
    back = undo(find_playbook_run(list_runs(journal)[0].run, journal), target, journal=journal)
    assert back.state == "done", back.message
    assert files_in(root) == {"kept": "old\n"}
    return True


def test_run_killed_at_every_journal_line_is_resumed(write_playbook: Callable[..., Path], tmp_path: Path) -> None:
    playbook = load(write_playbook(BOOK))
    # The journal has fourteen lines: start; step, change and step-end of four steps; end. The run is killed before each of
    # them, and after each `change`, before anything is changed. There is no fifteenth line, so that run ends.
    places = [*((at, False) for at in range(1, 16)), *((at, True) for at in (3, 6, 9, 12))]
    with ThreadPoolExecutor(2) as pool:
        outcomes = list(pool.map(lambda p: kill_and_resume(playbook, tmp_path / f"{p[0]}-{p[1]}", *p), places))
    killed = sum(outcomes)
    assert killed == 18


STOP_AND_START = """
vars: {root: {type: text}}
steps:
- name: stop
  on: laptop
  command: {run: "touch {{ root }}/stopped; while [ ! -e {{ root }}/go ]; do sleep 0.05; done", creates: "{{ root }}/stopped"}
- name: change
  on: laptop
  command: {run: "touch {{ root }}/done", creates: "{{ root }}/done"}
- name: start
  on: laptop
  always: true
  command: {run: "touch {{ root }}/started", creates: "{{ root }}/started"}
"""


@pytest.mark.parametrize("way", ["SIGTERM", "SIGHUP", "closed terminal"])
def test_run_starts_again_what_it_stopped_if_it_is_ended(way: str, write_playbook: Callable[..., Path], tmp_path: Path) -> None:
    playbook, root = write_playbook(STOP_AND_START), tmp_path / "root"
    root.mkdir()
    command = [sys.executable, "-m", "lupin_cli.app", "play", str(playbook), "-v", f"root={root}"]
    leader, follower = pty.openpty()
    environment = {**os.environ, "HOME": str(tmp_path), "XDG_STATE_HOME": str(tmp_path)}
    run = subprocess.Popen(
        command, stdin=follower, stdout=follower, stderr=follower, env=environment, start_new_session=True, close_fds=True
    )
    os.close(follower)
    try:
        wait_until((root / "stopped").exists, "the first step", 60.0)
        if way == "closed terminal":
            os.close(leader)
            run.send_signal(signal.SIGHUP)
        else:
            run.send_signal(signal.Signals[way])
        (root / "go").touch()
        assert run.wait(60) == (130 if way == "SIGTERM" else 0)
    finally:
        run.kill()
        run.wait()
    assert (root / "started").exists()
    assert (root / "done").exists() == (way != "SIGTERM")
