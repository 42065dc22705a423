"""SIGKILL at every point of a run: resume goes on from there, and undo leads back to what was before the first attempt."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from lupin_cli.runbook import Playbook, find_run, load, play
from lupin_cli.runbook.journal import list_runs
from lupin_cli.runbook.undo import undo
from lupin_cli.target.local import LocalTarget

BOOK = """
vars: {root: {type: text}}
steps:
- name: changes what is there
  file: {path: "{{ root }}/kept", content: "new\\n", mode: "0600"}
- name: a line
  as: line
  line-in-file: {path: "{{ root }}/kept", line: "more"}
- name: a link where the line is new
  when: line.changed
  symlink: {path: "{{ root }}/link", to: kept}
- name: takes its time
  command: {run: "sleep 0.05; touch {{ root }}/slow", creates: "{{ root }}/slow", reverse: "rm -f {{ root }}/slow"}
"""


def state(root: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in sorted(root.iterdir())}


def die_and_go_on(book: Playbook, folder: Path, at: int, after: bool) -> bool:
    """True where the run was killed; then everything that has to hold after it was seen to hold."""
    root, journal = folder / "machine", folder / "journal"
    root.mkdir(parents=True)
    (root / "kept").write_text("old\n")
    victim = [sys.executable, str(Path(__file__).with_name("play_and_die.py")), book.file, str(root), str(journal), str(at)]
    ended = subprocess.run([*victim, "after" if after else "before"], timeout=60, check=False)
    target = {"robot": LocalTarget("robot")}
    if ended.returncode == 0:
        assert state(root) == {"kept": "new\nmore\n", "link": "new\nmore\n", "slow": ""}
        return False
    assert ended.returncode == -9
    runs = list_runs(journal)
    if not runs:  # killed before its first line: nothing was done, and there is nothing to go on with
        assert state(root) == {"kept": "old\n"}
        assert play(book, target, {"root": str(root)}, journal=journal).state == "done"
    elif runs[0].state == "cut off":
        again = play(book, target, resume=True, journal=journal)
        assert (again.state, again.run) == ("done", runs[0].run), again.message
    assert state(root) == {"kept": "new\nmore\n", "link": "new\nmore\n", "slow": ""}
    back = undo(find_run(list_runs(journal)[0].run, journal), target, journal=journal)
    assert back.state == "done", back.message
    assert state(root) == {"kept": "old\n"}
    return True


def test_killed_at_every_line_of_the_journal_and_resumed(written: Callable[..., Path], tmp_path: Path) -> None:
    book = load(written(BOOK))
    # Fourteen lines: start; step, change and step-end of four steps; end. Before each of them, and right after an intention is
    # written, when nothing was done yet; the fifteenth never comes.
    places = [*((at, False) for at in range(1, 16)), *((at, True) for at in (3, 6, 9, 12))]
    with ThreadPoolExecutor(2) as pool:
        outcomes = list(pool.map(lambda p: die_and_go_on(book, tmp_path / f"{p[0]}-{p[1]}", *p), places))
    killed = sum(outcomes)
    assert killed == 18
