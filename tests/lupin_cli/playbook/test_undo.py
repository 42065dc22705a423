"""Undo of a run: which run is the latest, and what others have changed since."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from lupin_cli.connection.local import LocalTarget
from lupin_cli.playbook import Event, JournalError, Playbook, find_playbook_run, find_run_to_undo, play
from lupin_cli.playbook.run_record import RunRecord
from lupin_cli.playbook.undo import undo

LoadPlaybook = Callable[..., Playbook]
Targets = dict[str, LocalTarget]


def test_latest_run_to_undo_is_the_newest_with_a_change(load_playbook: LoadPlaybook, targets: Targets, tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    playbook = load_playbook(
        f"steps:\n- name: kept\n  undo: false\n  file: {{path: {tmp_path}/kept, content: x}}\n"
        f"- name: A\n  file: {{path: {tmp_path}/a, content: x}}"
    )
    first = play(playbook, targets, journal=journal).run
    (tmp_path / "kept").unlink()
    assert play(playbook, targets, journal=journal).changed == 1
    assert play(playbook, targets, journal=journal).changed == 0
    assert find_run_to_undo("latest", "book", folder=journal).run == first
    (journal / f"{first}.jsonl").unlink()
    with pytest.raises(JournalError, match="book has changed nothing on robot: there is nothing to undo"):
        find_run_to_undo("latest", "book", "robot", journal)


TWO_FILES = """
vars: {root: {type: text}}
steps:
- name: write a file
  file: {path: "{{ root }}/file", content: "new\\n"}
- name: add a line to it
  line-in-file: {path: "{{ root }}/file", line: "more"}
- name: add a line
  on: laptop
  line-in-file: {path: "{{ root }}/.bashrc", line: "source lupin"}
- name: link
  symlink: {path: "{{ root }}/link", to: "file"}
"""
OLD = {".bashrc": "old\n", "file": "old\n"}
NEW = {".bashrc": "old\nsource lupin\n", "file": "new\nmore\n", "link": "new\nmore\n"}


@pytest.fixture
def root(tmp_path: Path) -> Path:
    folder = tmp_path / "machine"
    folder.mkdir()
    for name, text in OLD.items():
        (folder / name).write_text(text)
    return folder


def files_in(root: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in sorted(root.iterdir())}


@pytest.fixture
def run(load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path) -> RunRecord:
    done = play(load_playbook(TWO_FILES), targets, {"root": str(root)}, journal=tmp_path / "journal")
    assert done.state == "done" and files_in(root) == NEW, done.message
    return find_playbook_run(done.run, tmp_path / "journal")


@pytest.mark.parametrize("dry_run", [True, False])
@pytest.mark.parametrize(("name", "step"), [(".bashrc", "add a line"), ("file", "add a line to it")])
def test_undo_is_refused_if_a_file_was_edited_since(
    run: RunRecord, targets: Targets, root: Path, tmp_path: Path, name: str, step: str, dry_run: bool
) -> None:
    with (root / name).open("a") as file:
        file.write("a person's line\n")
    edited = files_in(root)
    undone = undo(run, targets, journal=tmp_path / "journal", dry_run=dry_run)
    assert (undone.state, undone.exit_code, undone.run) == ("failed", 1, "")
    assert undone.message == f"{step}: changed since the run: {root}/{name}; --force overwrites that"
    assert undone.next_command == f"lupin journal show {run.run}"
    assert undone.resume == f"lupin play {tmp_path}/book.yaml --robot robot --undo {run.run} --force"
    assert files_in(root) == edited, "no other step is undone either"


def test_forced_undo_keeps_a_copy_of_what_it_overwrites(run: RunRecord, targets: Targets, root: Path, tmp_path: Path) -> None:
    (root / "file").write_text("a person's\n")
    (root / "file").chmod(0o600)
    (root / "link").unlink()
    (root / "link").symlink_to("elsewhere")
    asked: list[str] = []
    events: list[Event] = []

    def agree(question: str) -> bool:
        asked.append(question)
        return True

    undone = undo(run, targets, journal=tmp_path / "journal", force=True, confirm=agree, on_event=events.append)
    assert undone.state == "done", undone.message
    assert asked == [f"Undo 4 changes of {run.run}, and overwrite {root}/link, {root}/file?"]
    assert (root / "link.before-undo").readlink() == Path("elsewhere")
    (root / "link.before-undo").unlink()
    assert files_in(root) == {**OLD, "file.before-undo": "a person's\n"}
    assert (root / "file.before-undo").stat().st_mode & 0o777 == 0o600
    assert [event.text for event in events if "is kept as" in event.text] == [
        f"the changed {root}/{name} is kept as {root}/{name}.before-undo" for name in ("link", "file")
    ]


def test_removed_file_counts_as_changed_and_needs_no_copy(run: RunRecord, targets: Targets, root: Path, tmp_path: Path) -> None:
    (root / "file").unlink()
    assert "changed since" in undo(run, targets, journal=tmp_path / "journal").message
    assert undo(run, targets, journal=tmp_path / "journal", force=True).state == "done"
    assert files_in(root) == OLD


@pytest.mark.parametrize("undone_steps", [1, 2, 3, 4])
def test_interrupted_undo_is_continued_without_force(
    run: RunRecord, targets: Targets, root: Path, tmp_path: Path, undone_steps: int
) -> None:
    stop, ended = threading.Event(), list[Event]()

    def stop_after(event: Event) -> None:
        if event.kind == "step-end":
            ended.append(event)
            if len(ended) == undone_steps:
                stop.set()

    undo(run, targets, journal=tmp_path / "journal", stop=stop, on_event=stop_after)
    again = undo(run, targets, journal=tmp_path / "journal")
    assert again.state == "done" and files_in(root) == OLD, again.message


def test_file_that_a_later_run_changed_is_not_undone(
    run: RunRecord, load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path
) -> None:
    other = load_playbook(f"steps:\n- name: A\n  file: {{path: {root}/file, content: other}}", "other")
    later = play(other, targets, journal=tmp_path / "journal")
    assert "add a line to it: changed since the run" in undo(run, targets, journal=tmp_path / "journal").message
    assert undo(find_playbook_run(later.run, tmp_path / "journal"), targets, journal=tmp_path / "journal").state == "done"
    assert undo(run, targets, journal=tmp_path / "journal").state == "done"
    assert files_in(root) == OLD


def test_lines_added_to_bashrc_since_are_not_lost(
    load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    monkeypatch.setenv("HOME", str(root))
    monkeypatch.setenv("SHELL", "/bin/bash")
    (root / "dotfiles").mkdir()
    (root / ".bashrc").rename(root / "dotfiles" / "bashrc")
    (root / ".bashrc").symlink_to("dotfiles/bashrc")
    playbook = load_playbook("steps:\n- name: join\n  on: laptop\n  laptop-dds: {address: 10.42.0.1}")
    journal = tmp_path / "journal"
    run = find_playbook_run(play(playbook, targets, journal=journal).run, journal)
    with (root / ".bashrc").open("a") as file:
        file.write("# conda\n")
    edited = (root / ".bashrc").read_text()
    refused = undo(run, targets, journal=journal)
    assert refused.message == f"join: changed since the run: {root}/dotfiles/bashrc; --force overwrites that"
    assert (root / ".bashrc").read_text() == edited
    assert undo(run, targets, journal=journal, force=True).state == "done"
    assert (root / ".bashrc").read_text() == "old\n" and (root / ".bashrc").is_symlink()
    assert (root / "dotfiles" / "bashrc.before-undo").read_text() == edited
