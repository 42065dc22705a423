"""A resumed run and what has changed since it was cut off: an undo of it, and what its `require` steps protect."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lupin_cli.commands.journal import app
from lupin_cli.connection.local import LocalTarget
from lupin_cli.playbook import JournalError, Playbook, find_playbook_run, list_runs, play
from lupin_cli.playbook.undo import undo

LoadPlaybook = Callable[..., Playbook]
Targets = dict[str, LocalTarget]

GUARDED = """
vars: {root: {type: text}}
steps:
- name: which link
  as: link
  probe: {run: "cat {{ root }}/link"}
- name: not over the air
  require: {holds: "{{ link.stdout != 'air' }}", otherwise: it uses the air, next: lupin transport show}
- name: stop the air
  file: {path: "{{ root }}/stopped", content: x}
- name: work
  command:
    run: "test -e {{ root }}/allowed && touch {{ root }}/done"
    creates: "{{ root }}/done"
    reverse: "rm -f {{ root }}/done"
- name: only for a cable
  when: link.stdout == 'cable'
  file: {path: "{{ root }}/cable", content: x}
- name: still not over the air
  require: {holds: "{{ link.stdout != 'air' }}", otherwise: it uses the air again}
"""


@pytest.fixture
def root(tmp_path: Path) -> Path:
    folder = tmp_path / "machine"
    folder.mkdir()
    (folder / "link").write_text("cable\n")
    return folder


def test_undone_run_is_not_resumed(
    load_playbook: LoadPlaybook,
    targets: Targets,
    root: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    playbook = load_playbook(GUARDED)
    failed = play(playbook, targets, {"root": str(root)})
    assert failed.state == "failed" and (root / "stopped").exists()
    assert f"next: {failed.resume}" in CliRunner().invoke(app, ["show", failed.run]).output
    assert undo(find_playbook_run(failed.run), targets).state == "done"
    with pytest.raises(JournalError, match=f"an undo of {failed.run} has begun, so there is nothing to resume") as error:
        play(playbook, targets, resume=True)
    again = f"lupin play {tmp_path}/book.yaml --robot robot -v root={root}"
    assert error.value.next_command == again
    shown = CliRunner().invoke(app, ["show", failed.run]).output
    assert f"next: {again}" in shown and "--resume" not in shown
    assert json.loads(CliRunner().invoke(app, ["show", failed.run, "--json"]).output)["resume"] == ""
    assert not any(run["resume"] for run in json.loads(CliRunner().invoke(app, ["--json"]).output))
    (root / "allowed").touch()
    assert play(playbook, targets, {"root": str(root)}).state == "done"


def test_resumed_run_examines_again_what_it_requires(
    load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path
) -> None:
    playbook, journal = load_playbook(GUARDED), tmp_path / "journal"
    assert play(playbook, targets, {"root": str(root)}, journal=journal).state == "failed"
    (root / "allowed").touch()
    (root / "link").write_text("air\n")
    for _ in range(2):
        refused = play(playbook, targets, resume=True, journal=journal)
        assert (refused.state, refused.message) == ("failed", "not over the air: it uses the air")
        assert refused.next_command == "lupin transport show --robot robot" and not (root / "done").exists()
        assert [step.state for step in refused.steps] == ["same", "failed"]
    (root / "link").write_text("another cable\n")
    again = play(playbook, targets, resume=True, journal=journal)
    assert again.state == "done" and len(list_runs(journal)) == 1, again.message
    assert (root / "cable").exists(), "conditions of later steps use the results of the run's beginning"


def test_resumed_run_passes_a_requirement_met_since(
    load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path
) -> None:
    playbook, journal = load_playbook(GUARDED), tmp_path / "journal"
    (root / "link").write_text("air\n")
    (root / "allowed").touch()
    assert play(playbook, targets, {"root": str(root)}, journal=journal).message == "not over the air: it uses the air"
    (root / "link").write_text("cable\n")
    assert play(playbook, targets, resume=True, dry_run=True, journal=journal).state == "done"
    assert play(playbook, targets, resume=True, journal=journal).state == "done"


def test_requirement_after_the_resumed_step_is_judged_by_now(
    load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path
) -> None:
    body = GUARDED.replace("- name: not over the air\n", "- name: not over the air\n  when: link.stdout == 'nothing'\n")
    playbook, journal = load_playbook(body), tmp_path / "journal"
    assert play(playbook, targets, {"root": str(root)}, journal=journal).state == "failed"
    (root / "allowed").touch()
    (root / "link").write_text("air\n")
    refused = play(playbook, targets, resume=True, journal=journal)
    assert refused.message == "still not over the air: it uses the air again"
    assert [step.state for step in refused.steps] == ["same", "skipped", "changed", "changed", "changed", "failed"]
