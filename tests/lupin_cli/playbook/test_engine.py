"""Playbook runs on this machine: idempotence, dry run, resume, undo, timeouts, included playbooks and the journal."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.connection.base import Unreachable
from lupin_cli.connection.local import LocalTarget
from lupin_cli.playbook import (
    Event,
    JournalError,
    Playbook,
    PlaybookError,
    find_playbook_run,
    find_run_to_undo,
    list_runs,
    play,
)
from lupin_cli.playbook.undo import undo

Targets = dict[str, LocalTarget]
LoadPlaybook = Callable[..., Playbook]

THREE_STEPS = """
vars: {root: {type: text}, word: hello}
steps:
- name: make a directory
  directory: {path: "{{ root }}/a/b"}
- name: write a file in it
  as: note
  file: {path: "{{ root }}/a/b/note", content: "{{ word }}\\n", mode: "0600"}
- name: link to it if it is new
  when: note.changed
  symlink: {path: "{{ root }}/link", to: "a/b/note"}
"""


def snapshot_files(root: Path) -> dict[str, Any]:
    """Return the modes, link targets and contents of all files in a folder, by name."""
    found: dict[str, Any] = {}
    for path in sorted(root.rglob("*")):
        content = str(path.readlink()) if path.is_symlink() else path.read_bytes() if path.is_file() else None
        found[str(path.relative_to(root))] = (path.lstat().st_mode, content)
    return found


@pytest.fixture
def root(tmp_path: Path) -> Path:
    folder = tmp_path / "machine"
    folder.mkdir()
    return folder


def test_second_run_changes_nothing_and_undo_restores(
    load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path
) -> None:
    playbook, journal = load_playbook(THREE_STEPS), tmp_path / "journal"
    first = play(playbook, targets, {"root": str(root)}, journal=journal)
    assert (first.state, [step.state for step in first.steps]) == ("done", ["changed"] * 3), first.message
    assert (root / "link").read_text() == "hello\n"
    after = snapshot_files(root)
    second = play(playbook, targets, {"root": str(root)}, journal=journal)
    assert [step.state for step in second.steps] == ["same", "same", "skipped"]
    assert snapshot_files(root) == after
    undone = undo(find_playbook_run(first.run, journal), targets, journal=journal)
    assert (undone.state, snapshot_files(root)) == ("done", {}), undone.message
    assert undo(find_playbook_run(first.run, journal), targets, journal=journal).state == "done"


def test_dry_run_shows_differences_and_changes_nothing(
    load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path
) -> None:
    (root / "a" / "b").mkdir(parents=True)
    (root / "a" / "b" / "note").write_text("old\n")
    before, events = snapshot_files(root), list[Event]()
    result = play(
        load_playbook(THREE_STEPS),
        targets,
        {"root": str(root)},
        dry_run=True,
        diff=True,
        journal=tmp_path / "journal",
        on_event=events.append,
    )
    assert [step.state for step in result.steps] == ["same", "would-change", "would-change"]
    assert (result.state, result.changed, snapshot_files(root)) == ("done", 2, before)
    assert any("-old\n+hello" in event.diff for event in events)
    assert not (tmp_path / "journal").exists()


@pytest.mark.parametrize(
    ("variables", "message"),
    [
        ({}, "'root' must be given"),
        ({"root": "/x", "wrod": 1}, "no variable 'wrod'; did you mean 'word'"),
        ({"root": 3}, "expected text, found 3"),
        ({"root": "relative"}, "a path must begin with / or ~/"),
    ],
)
def test_invalid_variables_are_refused_before_anything_runs(
    variables: dict[str, Any], message: str, load_playbook: LoadPlaybook, targets: Targets, tmp_path: Path
) -> None:
    with pytest.raises(PlaybookError) as refused:
        play(load_playbook(THREE_STEPS.replace("directory:", "file:")), targets, variables, journal=tmp_path / "journal")
    assert message in str(refused.value)
    assert not (tmp_path / "journal").exists()


def test_playbook_for_a_robot_needs_a_robot(load_playbook: LoadPlaybook, targets: Targets) -> None:
    with pytest.raises(PlaybookError, match="works on the robot, but no robot was named"):
        play(load_playbook(THREE_STEPS), {"laptop": targets["laptop"]}, {"root": "/x"})


FAILING = """
vars: {root: {type: text}}
steps:
- name: first
  file: {path: "{{ root }}/first", content: "1"}
- name: second
  command: {run: "test -e {{ root }}/allowed && touch {{ root }}/second", creates: "{{ root }}/second"}
- name: third
  file: {path: "{{ root }}/third", content: "3"}
"""


def test_failed_run_stops_and_resume_continues_it(
    load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path
) -> None:
    playbook, journal = load_playbook(FAILING), tmp_path / "journal"
    first = play(playbook, targets, {"root": str(root)}, journal=journal)
    assert (first.state, first.exit_code, [step.state for step in first.steps]) == ("failed", 1, ["changed", "failed"])
    assert first.next_command == f"lupin play {tmp_path}/book.yaml --robot robot --resume"
    assert "could not run" in first.message and not (root / "third").exists()
    (root / "allowed").touch()
    (root / "first").unlink()  # resume does not examine a finished step again
    again = play(playbook, targets, resume=True, journal=journal)
    assert (again.state, again.run) == ("done", first.run)
    assert [step.state for step in again.steps] == ["changed", "changed", "changed"]
    assert not (root / "first").exists()
    assert play(playbook, targets, resume=True, journal=journal).message == "there is no unfinished run of book"


def test_dry_run_of_resume_leaves_the_journal_alone(
    load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path
) -> None:
    journal = tmp_path / "journal"
    failed = play(load_playbook(FAILING), targets, {"root": str(root)}, journal=journal)
    (root / "allowed").touch()
    journal_before = (journal / f"{failed.run}.jsonl").read_bytes()
    dry = play(load_playbook(FAILING), targets, resume=True, dry_run=True, journal=journal)
    assert (dry.state, [step.state for step in dry.steps]) == ("done", ["changed", "would-change", "would-change"])
    assert (journal / f"{failed.run}.jsonl").read_bytes() == journal_before
    assert play(load_playbook(FAILING), targets, resume=True, journal=journal).run == failed.run


def test_resume_refuses_changed_text_and_variables(
    load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path
) -> None:
    journal = tmp_path / "journal"
    play(load_playbook(FAILING), targets, {"root": str(root)}, journal=journal)
    with pytest.raises(PlaybookError, match="was started with root="):
        play(load_playbook(FAILING), targets, {"root": "/else"}, resume=True, journal=journal)
    with pytest.raises(PlaybookError, match="has changed since"):
        play(load_playbook(FAILING + "\n# more"), targets, resume=True, journal=journal)


def test_from_step_skips_changes_and_runs_probes_before_it(
    load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path
) -> None:
    playbook = load_playbook(
        f"""
steps:
- name: ask
  as: answer
  probe: {{run: echo 42}}
- name: skipped
  file: {{path: {root}/skipped, content: x}}
- name: wanted
  when: answer.number == 42
  file: {{path: {root}/wanted, content: "{{{{ answer.stdout }}}}"}}
"""
    )
    result = play(playbook, targets, from_step="wanted", journal=tmp_path / "journal")
    assert [step.state for step in result.steps] == ["same", "skipped", "changed"], result.message
    assert sorted(path.name for path in root.iterdir()) == ["wanted"] and (root / "wanted").read_text() == "42"
    assert play(playbook, targets, from_step="2", journal=tmp_path / "journal").steps[1].state == "changed"
    with pytest.raises(PlaybookError, match="no step 'wnted', by name or by number from 1 to 3; did you mean 'wanted'"):
        play(playbook, targets, from_step="wnted", journal=tmp_path / "journal")


def test_tag_selects_steps_and_is_kept_for_resume(
    load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path
) -> None:
    body = (
        f"steps:\n- name: ask\n  as: answer\n  probe: {{run: echo 42}}\n"
        f"- name: one\n  tags: [first]\n  file: {{path: {root}/one, content: x}}\n"
        f"- name: two\n  tags: [second, both]\n"
        f"  command: {{run: '[ -e {root}/go ] && touch {root}/two', creates: {root}/two}}\n"
        f"- name: none\n  file: {{path: {root}/none, content: x}}"
    )
    playbook, journal = load_playbook(body), tmp_path / "journal"
    failed = play(playbook, targets, tags=["both"], journal=journal)
    assert [step.state for step in failed.steps] == ["same", "skipped", "failed"], failed.message
    (root / "go").touch()
    again = play(playbook, targets, resume=True, journal=journal)
    assert [step.state for step in again.steps] == ["same", "skipped", "changed", "skipped"], again.message
    assert {path.name for path in root.iterdir()} == {"go", "two"}
    with pytest.raises(PlaybookError, match="no step has the tag 'frist'; did you mean 'first'"):
        play(playbook, targets, tags=["frist"], journal=journal)


def test_retry_repeats_a_failed_step_and_until_polls(
    load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path
) -> None:
    playbook = load_playbook(
        f"""
steps:
- name: fails twice
  retry: {{times: 2, pause_s: 0.05}}
  command:
    run: "echo x >> {root}/tries; [ $(wc -l < {root}/tries) -ge 3 ]"
    unless: "[ $(cat {root}/tries 2>/dev/null | wc -l) -ge 3 ]"
- name: counts
  as: count
  until: count.number >= 3
  timeout: 20
  probe: {{run: "echo x >> {root}/asked; wc -l < {root}/asked"}}
"""
    )
    result = play(playbook, targets, journal=tmp_path / "journal")
    assert result.state == "done", result.message
    assert (root / "tries").read_text() == (root / "asked").read_text() == "x\n" * 3


def test_dry_run_does_not_wait_for_what_it_would_start(
    load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path
) -> None:
    body = f"steps:\n- name: start\n  file: {{path: {root}/started, content: x}}\n- name: wait\n  wait-for: {{path: {root}/up}}"
    dry = play(load_playbook(body), targets, dry_run=True, journal=tmp_path / "journal")
    assert [step.summary for step in dry.steps] == [f"create {root}/started", "wait for what the steps above start"]
    (root / "started").write_text("x")
    started = play(load_playbook(body), targets, dry_run=True, journal=tmp_path / "journal")
    assert [step.summary for step in started.steps] == ["", f"wait: {root}/up does not exist"]


def test_until_ends_at_the_timeout_with_the_last_values(load_playbook: LoadPlaybook, targets: Targets, tmp_path: Path) -> None:
    playbook = load_playbook(
        "steps:\n- name: A\n  as: a\n  until: a.status == 0\n  timeout: 3\n  probe: {run: echo no; exit 3}"
    )
    result = play(playbook, targets, journal=tmp_path / "journal")
    assert (result.state, result.exit_code) == ("failed", 1)
    assert "'a.status == 0' did not hold within 3 s; at the end: status = 3, stdout = 'no'" in result.message


def test_step_fails_at_its_timeout(load_playbook: LoadPlaybook, targets: Targets, tmp_path: Path) -> None:
    playbook = load_playbook("steps:\n- name: A\n  timeout: 1\n  command: {run: sleep 60, creates: /no/such}")
    result = play(playbook, targets, journal=tmp_path / "journal")
    assert result.state == "failed" and "did not end in time" in result.message, result.message


def test_change_that_does_not_hold_fails_the_step(load_playbook: LoadPlaybook, targets: Targets, tmp_path: Path) -> None:
    playbook = load_playbook("steps:\n- name: A\n  command: {run: 'true', creates: /no/such}")
    result = play(playbook, targets, journal=tmp_path / "journal")
    assert result.state == "failed" and "the change did not hold; still to do: run: true" in result.message


def test_confirm_asks_only_if_something_changes(
    load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path
) -> None:
    playbook = load_playbook(
        f"vars: {{who: it}}\nsteps:\n- name: A\n  confirm: 'Write {{{{ who }}}}?'\n  file: {{path: {root}/a, content: x}}"
    )
    asked: list[str] = []
    journal = tmp_path / "journal"
    assert play(playbook, targets, journal=journal).state == "declined"
    assert play(playbook, targets, journal=journal, confirm=lambda q: bool(asked.append(q))).state == "declined"  # type: ignore[func-returns-value]
    assert asked == ["Write it?"] and not (root / "a").exists() and not journal.exists()
    assert play(playbook, targets, journal=journal, confirm=lambda _q: True).state == "done"
    assert play(playbook, targets, journal=journal).state == "done"


def test_all_questions_come_before_the_first_change(
    load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path
) -> None:
    # The second question depends on a change of the run itself, as that of a reboot does.
    body = (
        f"steps:\n- name: A\n  as: first\n  file: {{path: {root}/a, content: x}}\n"
        f"- name: B\n  confirm: Write b?\n  file: {{path: {root}/b, content: x}}\n"
        f"- name: C\n  when: first.changed\n  confirm: Reboot it?\n  command: {{run: touch {root}/c, creates: {root}/c}}"
    )
    playbook, asked = load_playbook(body), []

    def answer(question: str) -> bool:
        asked.append((question, sorted(path.name for path in root.iterdir())))
        return question != refused

    refused = "Reboot it?"
    no = play(playbook, targets, journal=tmp_path / "journal", confirm=answer)
    assert (no.state, no.exit_code, no.run) == ("declined", 1, "") and "Nothing was changed" in no.message
    assert no.next_command == f"lupin play {tmp_path}/book.yaml --robot robot --yes"
    assert asked == [("Write b?", []), ("Reboot it?", [])] and not list(root.iterdir())
    refused = ""
    yes = play(playbook, targets, journal=tmp_path / "journal", confirm=answer)
    assert yes.state == "done" and len(asked) == 4 and {path.name for path in root.iterdir()} == {"a", "b", "c"}


def test_undo_of_latest_is_that_playbooks_newest_run(
    load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path
) -> None:
    journal = tmp_path / "journal"
    mine, other = (
        load_playbook(f"steps:\n- name: A\n  file: {{path: {root}/{name}, content: x}}", name) for name in ("mine", "other")
    )
    run = play(mine, targets, journal=journal).run
    newer = play(other, targets, journal=journal).run
    found = find_run_to_undo("latest", "mine", folder=journal)
    assert found.run == run
    with pytest.raises(JournalError, match=f"{newer} is a run of other, not of mine") as caught:
        find_run_to_undo(newer, "mine", folder=journal)
    assert caught.value.next_command == f"lupin play {tmp_path}/other.yaml --robot robot --undo {newer}"
    assert undo(found, targets, journal=journal).state == "done"
    assert not (root / "mine").exists() and (root / "other").exists()
    assert find_run_to_undo("latest", "mine", folder=journal).run == run, "an undo is no run to undo"
    with pytest.raises(JournalError, match="mine has not been played on pot-1"):
        find_run_to_undo("latest", "mine", "pot-1", journal)


def test_always_steps_run_after_failure_and_forbid_resume(
    load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path
) -> None:
    body = (
        f"vars: {{fail: {{type: truth}}}}\nsteps:\n"
        f"- name: down\n  command: {{run: rm {root}/up, unless: '[ ! -e {root}/up ]'}}\n"
        f"- name: work\n  require: {{holds: '{{{{ not fail }}}}', otherwise: it broke}}\n"
        f"- name: more work\n  file: {{path: {root}/more, content: x}}\n"
        f"- name: up\n  always: true\n  file: {{path: {root}/up, content: x}}"
    )
    (root / "up").touch()
    journal = tmp_path / "journal"
    result = play(load_playbook(body), targets, {"fail": True}, journal=journal)
    assert [(step.name, step.state) for step in result.steps] == [("down", "changed"), ("work", "failed"), ("up", "changed")]
    command = f"lupin play {tmp_path}/book.yaml --robot robot -v fail=true"
    assert (result.state, result.message, result.next_command) == ("failed", "work: it broke", command)
    assert [path.name for path in root.iterdir()] == ["up"]
    with pytest.raises(JournalError, match="so there is nothing to resume"):
        play(load_playbook(body), targets, {"fail": True}, resume=True, journal=journal)
    assert play(load_playbook(body), targets, {"fail": False}, journal=journal).state == "done"


def test_undo_restores_content_and_mode_but_not_undo_false(
    load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path
) -> None:
    (root / "a").write_text("old")
    (root / "a").chmod(0o640)
    playbook = load_playbook(
        f"steps:\n- name: A\n  file: {{path: {root}/a, content: new, mode: '0600'}}\n"
        f"- name: B\n  undo: false\n  file: {{path: {root}/b, content: new}}"
    )
    journal = tmp_path / "journal"
    run = play(playbook, targets, journal=journal).run
    assert undo(find_playbook_run(run, journal), targets, journal=journal).state == "done"
    assert ((root / "a").read_text(), (root / "a").stat().st_mode & 0o777, (root / "b").exists()) == ("old", 0o640, True)


def test_included_steps_see_only_their_own_names(
    load_playbook: LoadPlaybook, write_playbook: Callable[..., Path], targets: Targets, root: Path, tmp_path: Path
) -> None:
    write_playbook(
        f"vars: {{name: inner, to: {{type: text}}}}\nsteps:\n- name: write\n  as: done\n"
        f"  file: {{path: '{root}/{{{{ name }}}}', content: '{{{{ to }}}}'}}\n"
        f"- name: again\n  when: done.changed\n  file: {{path: '{root}/again', content: ''}}",
        "inner",
    )
    playbook = load_playbook(
        "vars: {word: hi, go: true}\nsteps:\n- name: ask\n  as: asked\n  probe: {run: echo there}\n"
        "- include: inner\n  vars: {to: '{{ word }} {{ asked.stdout }}'}\n"
        "- include: inner\n  name: never\n  when: not go\n  vars: {to: ''}",
        "outer",
    )
    result = play(playbook, targets, journal=tmp_path / "journal")
    assert [(step.name, step.state) for step in result.steps] == [
        ("ask", "same"),
        ("inner / write", "changed"),
        ("inner / again", "changed"),
        ("never / write", "skipped"),
        ("never / again", "skipped"),
    ], result.message
    assert (root / "inner").read_text() == "hi there"


class DisconnectingTarget(LocalTarget):
    """This machine as a robot whose connection is lost after `calls_before_loss` calls."""

    def __init__(self, calls_before_loss: int) -> None:
        super().__init__("robot")
        self.calls_left = calls_before_loss

    def _count(self) -> None:
        self.calls_left -= 1
        if self.calls_left < 0:
            raise Unreachable("robot: the connection was lost", "lost", "lupin transport")

    def batch(self, *arguments: Any, **more: Any) -> Any:
        self._count()
        return super().batch(*arguments, **more)

    def run(self, *arguments: Any, **more: Any) -> Any:
        self._count()
        return super().run(*arguments, **more)


def test_connection_lost_at_any_call_is_resumed_and_undone(
    load_playbook: LoadPlaybook, targets: Targets, tmp_path: Path
) -> None:
    playbook, lost = load_playbook(THREE_STEPS), 0
    for calls in range(0, 40, 2):
        root, journal = tmp_path / f"machine{calls}", tmp_path / f"journal{calls}"
        root.mkdir()
        first = play(playbook, {"robot": DisconnectingTarget(calls)}, {"root": str(root)}, journal=journal)
        if first.state == "done":
            break
        lost += 1
        assert (first.state, first.exit_code, first.next_command) == ("unreachable", 3, "lupin transport")
        again = play(playbook, targets, resume=True, journal=journal)
        assert again.state == "done" and (root / "link").read_text() == "hello\n", again.message
        assert undo(find_playbook_run(again.run, journal), targets, journal=journal).state == "done"
        assert snapshot_files(root) == {}
    assert lost >= 5


def test_interrupted_run_stops_between_steps(load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path) -> None:
    stop, journal = threading.Event(), tmp_path / "journal"

    def after_first(event: Event) -> None:
        if event.kind == "step-end":
            stop.set()

    result = play(load_playbook(THREE_STEPS), targets, {"root": str(root)}, journal=journal, on_event=after_first, stop=stop)
    assert (result.state, result.exit_code, len(result.steps)) == ("interrupted", 130, 1)
    assert play(load_playbook(THREE_STEPS), targets, resume=True, journal=journal).state == "done"


def test_journal_masks_secrets_in_variables_and_output(
    load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path
) -> None:
    journal = tmp_path / "journal"
    playbook = load_playbook(
        f"vars: {{key: {{type: secret}}}}\nsteps:\n- name: A\n"
        f"  command: {{run: 'echo got {{{{ key }}}} and wifi.psk=other-thing; touch {root}/a; exit 1', creates: {root}/b}}"
    )
    result = play(playbook, targets, {"key": "correct-horse"}, journal=journal)
    text = next(journal.iterdir()).read_text()
    assert "got ***" in text and "wifi.psk=***" in text
    assert "correct-horse" not in text + result.message and "other-thing" not in text
    assert (next(journal.iterdir()).stat().st_mode & 0o777) == 0o600
    with pytest.raises(PlaybookError, match=r"give them again: --hidden key"):
        play(playbook, targets, resume=True, journal=journal)


def test_journal_keeps_head_and_tail_of_100_mb_output(
    load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path
) -> None:
    much = f"echo begun; head -c 100000000 /dev/zero | tr '\\\\0' x; echo; echo ended; touch {root}/done"
    playbook = load_playbook(f'steps:\n- name: much\n  command: {{run: "{much}", creates: {root}/done}}\n')
    line_lengths: list[int] = []
    result = play(playbook, targets, journal=tmp_path / "j", on_event=lambda e: line_lengths.append(len(e.text)))
    assert result.state == "done", result.message
    run = find_playbook_run(result.run, tmp_path / "j")
    assert run.path.stat().st_size < 200_000
    (output,) = run.steps[0].outputs
    assert output.startswith("begun\nxxx") and output.endswith("xxx\nended\n") and "characters left out" in output
    assert 100_000_000 < sum(line_lengths) < 100_010_000, "events have the whole output"


def test_journal_with_an_incomplete_last_line_is_read(
    load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path
) -> None:
    journal = tmp_path / "journal"
    run = play(load_playbook(THREE_STEPS), targets, {"root": str(root)}, journal=journal).run
    path = journal / f"{run}.jsonl"
    whole = path.read_bytes()
    for cut in range(whole.index(b"\n") + 1, len(whole), 7):
        path.write_bytes(whole[:cut])
        record = find_playbook_run(run, journal)
        assert record.torn_lines <= 1 and record.state in ("cut off", "done")
        assert len(record.steps) <= 3
    path.write_bytes(whole[: len(whole) - 40])
    assert play(load_playbook(THREE_STEPS), targets, resume=True, journal=journal).state == "done"
    lines = path.read_text().splitlines()
    assert json.loads(lines[-1])["event"] == "end" and find_playbook_run(run, journal).torn_lines == 1
    path.write_bytes(whole[:10])
    assert list_runs(journal) == []
