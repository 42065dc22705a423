"""Playing on this machine: what is asked happens once, a dry run changes nothing, a failure stops and says how to go on."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.runbook import Event, JournalError, Playbook, PlaybookError, find_run, list_runs, play
from lupin_cli.runbook.undo import undo
from lupin_cli.target.base import Unreachable
from lupin_cli.target.local import LocalTarget

Targets = dict[str, LocalTarget]
Loaded = Callable[..., Playbook]

THREE = """
vars: {root: {type: text}, word: hello}
steps:
- name: a folder
  directory: {path: "{{ root }}/a/b"}
- name: a file in it
  as: note
  file: {path: "{{ root }}/a/b/note", content: "{{ word }}\\n", mode: "0600"}
- name: a link to it, where it is new
  when: note.changed
  symlink: {path: "{{ root }}/link", to: "a/b/note"}
"""


def tree(root: Path) -> dict[str, Any]:
    """What is in a folder: names, rights, links, contents."""
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


def test_it_happens_once_and_can_be_taken_back(loaded: Loaded, targets: Targets, root: Path, tmp_path: Path) -> None:
    book, journal = loaded(THREE), tmp_path / "journal"
    first = play(book, targets, {"root": str(root)}, journal=journal)
    assert (first.state, [step.state for step in first.steps]) == ("done", ["changed"] * 3), first.message
    assert (root / "link").read_text() == "hello\n"
    after = tree(root)
    second = play(book, targets, {"root": str(root)}, journal=journal)
    assert [step.state for step in second.steps] == ["same", "same", "skipped"]
    assert tree(root) == after
    back = undo(find_run(first.run, journal), targets, journal=journal)
    assert (back.state, tree(root)) == ("done", {}), back.message
    assert undo(find_run(first.run, journal), targets, journal=journal).state == "done"


def test_a_dry_run_shows_all_and_changes_nothing(loaded: Loaded, targets: Targets, root: Path, tmp_path: Path) -> None:
    (root / "a" / "b").mkdir(parents=True)
    (root / "a" / "b" / "note").write_text("old\n")
    before, events = tree(root), list[Event]()
    result = play(
        loaded(THREE),
        targets,
        {"root": str(root)},
        dry_run=True,
        diff=True,
        journal=tmp_path / "journal",
        on_event=events.append,
    )
    assert [step.state for step in result.steps] == ["same", "would-change", "would-change"]
    assert (result.state, result.changed, tree(root)) == ("done", 2, before)
    assert any("-old\n+hello" in event.diff for event in events)
    assert not (tmp_path / "journal").exists()


@pytest.mark.parametrize(
    ("variables", "words"),
    [
        ({}, "'root' must be given"),
        ({"root": "/x", "wrod": 1}, "no variable 'wrod'; the nearest is 'word'"),
        ({"root": 3}, "expected text, found 3"),
        ({"root": "relative"}, "a path begins with / or ~/"),
    ],
)
def test_unfit_variables_are_refused_before_anything_runs(
    variables: dict[str, Any], words: str, loaded: Loaded, targets: Targets, tmp_path: Path
) -> None:
    with pytest.raises(PlaybookError) as refused:
        play(loaded(THREE.replace("directory:", "file:")), targets, variables, journal=tmp_path / "journal")
    assert words in str(refused.value)
    assert not (tmp_path / "journal").exists()


def test_a_playbook_for_a_robot_wants_one_named(loaded: Loaded, targets: Targets) -> None:
    with pytest.raises(PlaybookError, match="works on the robot, and none is named"):
        play(loaded(THREE), {"laptop": targets["laptop"]}, {"root": "/x"})


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


def test_a_failure_stops_says_how_to_go_on_and_resume_does(
    loaded: Loaded, targets: Targets, root: Path, tmp_path: Path
) -> None:
    book, journal = loaded(FAILING), tmp_path / "journal"
    first = play(book, targets, {"root": str(root)}, journal=journal)
    assert (first.state, first.exit_code, [step.state for step in first.steps]) == ("failed", 1, ["changed", "failed"])
    assert first.next_command == "lupin play book --robot robot --resume"
    assert "could not run" in first.message and not (root / "third").exists()
    (root / "allowed").touch()
    (root / "first").unlink()  # what is done stays done: resume doesn't look at it again
    again = play(book, targets, resume=True, journal=journal)
    assert (again.state, again.run) == ("done", first.run)
    assert [step.state for step in again.steps] == ["changed", "changed", "changed"]
    assert not (root / "first").exists()
    assert play(book, targets, resume=True, journal=journal).message == "no run of book was left unfinished"


def test_resume_refuses_another_text_and_other_variables(loaded: Loaded, targets: Targets, root: Path, tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    play(loaded(FAILING), targets, {"root": str(root)}, journal=journal)
    with pytest.raises(PlaybookError, match="was begun with root="):
        play(loaded(FAILING), targets, {"root": "/else"}, resume=True, journal=journal)
    with pytest.raises(PlaybookError, match="has changed since"):
        play(loaded(FAILING + "\n# more"), targets, resume=True, journal=journal)


def test_from_step_skips_changes_before_it_but_reads_what_later_steps_need(
    loaded: Loaded, targets: Targets, root: Path, tmp_path: Path
) -> None:
    book = loaded(
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
    result = play(book, targets, from_step="wanted", journal=tmp_path / "journal")
    assert [step.state for step in result.steps] == ["same", "skipped", "changed"], result.message
    assert sorted(path.name for path in root.iterdir()) == ["wanted"] and (root / "wanted").read_text() == "42"
    assert play(book, targets, from_step="2", journal=tmp_path / "journal").steps[1].state == "changed"
    with pytest.raises(PlaybookError, match="no step 'wnted'; the nearest is 'wanted'"):
        play(book, targets, from_step="wnted", journal=tmp_path / "journal")


def test_retry_tries_again_and_until_waits(loaded: Loaded, targets: Targets, root: Path, tmp_path: Path) -> None:
    book = loaded(
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
    result = play(book, targets, journal=tmp_path / "journal")
    assert result.state == "done", result.message
    assert (root / "tries").read_text() == (root / "asked").read_text() == "x\n" * 3


def test_until_gives_up_at_the_time_out_and_tells_what_it_saw(loaded: Loaded, targets: Targets, tmp_path: Path) -> None:
    book = loaded("steps:\n- name: A\n  as: a\n  until: a.status == 0\n  timeout: 3\n  probe: {run: echo no; exit 3}")
    result = play(book, targets, journal=tmp_path / "journal")
    assert (result.state, result.exit_code) == ("failed", 1)
    assert "'a.status == 0' did not hold within 3 s; at the end: status = 3, stdout = 'no'" in result.message


def test_a_step_that_takes_too_long_is_cut_at_its_time_out(loaded: Loaded, targets: Targets, tmp_path: Path) -> None:
    book = loaded("steps:\n- name: A\n  timeout: 1\n  command: {run: sleep 60, creates: /no/such}")
    result = play(book, targets, journal=tmp_path / "journal")
    assert result.state == "failed" and "did not end in time" in result.message, result.message


def test_a_change_that_does_not_hold_is_a_failure(loaded: Loaded, targets: Targets, tmp_path: Path) -> None:
    book = loaded("steps:\n- name: A\n  command: {run: 'true', creates: /no/such}")
    result = play(book, targets, journal=tmp_path / "journal")
    assert result.state == "failed" and "it was changed, but runs: true" in result.message


def test_a_question_is_asked_only_where_something_changes(loaded: Loaded, targets: Targets, root: Path, tmp_path: Path) -> None:
    book = loaded(
        f"vars: {{who: it}}\nsteps:\n- name: A\n  confirm: 'Write {{{{ who }}}}?'\n  file: {{path: {root}/a, content: x}}"
    )
    asked: list[str] = []
    journal = tmp_path / "journal"
    assert play(book, targets, journal=journal).state == "declined"
    assert play(book, targets, journal=journal, confirm=lambda q: bool(asked.append(q))).state == "declined"
    assert asked == ["Write it?"] and not (root / "a").exists()
    assert play(book, targets, journal=journal, confirm=lambda q: True).state == "done"
    assert play(book, targets, journal=journal).state == "done"


def test_what_is_done_always_is_done_after_a_failure_and_there_is_nothing_to_resume(
    loaded: Loaded, targets: Targets, root: Path, tmp_path: Path
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
    result = play(loaded(body), targets, {"fail": True}, journal=journal)
    assert [(step.name, step.state) for step in result.steps] == [("down", "changed"), ("work", "failed"), ("up", "changed")]
    assert (result.state, result.message, result.next_command) == ("failed", "work: it broke", "lupin play book --robot robot")
    assert [path.name for path in root.iterdir()] == ["up"]
    with pytest.raises(JournalError, match="was put in order: there is nothing half-way"):
        play(loaded(body), targets, {"fail": True}, resume=True, journal=journal)
    assert play(loaded(body), targets, {"fail": False}, journal=journal).state == "done"


def test_undo_leaves_steps_that_say_so_and_restores_what_was(
    loaded: Loaded, targets: Targets, root: Path, tmp_path: Path
) -> None:
    (root / "a").write_text("old")
    (root / "a").chmod(0o640)
    book = loaded(
        f"steps:\n- name: A\n  file: {{path: {root}/a, content: new, mode: '0600'}}\n"
        f"- name: B\n  undo: false\n  file: {{path: {root}/b, content: new}}"
    )
    journal = tmp_path / "journal"
    run = play(book, targets, journal=journal).run
    assert undo(find_run(run, journal), targets, journal=journal).state == "done"
    assert ((root / "a").read_text(), (root / "a").stat().st_mode & 0o777, (root / "b").exists()) == ("old", 0o640, True)


def test_included_steps_see_their_own_names_only(
    loaded: Loaded, written: Callable[..., Path], targets: Targets, root: Path, tmp_path: Path
) -> None:
    written(
        f"vars: {{name: inner, to: {{type: text}}}}\nsteps:\n- name: write\n  as: done\n"
        f"  file: {{path: '{root}/{{{{ name }}}}', content: '{{{{ to }}}}'}}\n"
        f"- name: again\n  when: done.changed\n  file: {{path: '{root}/again', content: ''}}",
        "inner",
    )
    book = loaded(
        "vars: {word: hi, go: true}\nsteps:\n- name: ask\n  as: asked\n  probe: {run: echo there}\n"
        "- include: inner\n  vars: {to: '{{ word }} {{ asked.stdout }}'}\n"
        "- include: inner\n  name: never\n  when: not go\n  vars: {to: ''}",
        "outer",
    )
    result = play(book, targets, journal=tmp_path / "journal")
    assert [(step.name, step.state) for step in result.steps] == [
        ("ask", "same"),
        ("inner / write", "changed"),
        ("inner / again", "changed"),
        ("never / write", "skipped"),
        ("never / again", "skipped"),
    ], result.message
    assert (root / "inner").read_text() == "hi there"


class Cut(LocalTarget):
    """This machine behind a cable that is pulled before its n-th call."""

    def __init__(self, calls: int) -> None:
        super().__init__("robot")
        self.calls = calls

    def _count(self) -> None:
        self.calls -= 1
        if self.calls < 0:
            raise Unreachable("robot: the connection was lost", "lost", "lupin transport")

    def batch(self, *arguments: Any, **more: Any) -> Any:
        self._count()
        return super().batch(*arguments, **more)

    def run(self, *arguments: Any, **more: Any) -> Any:
        self._count()
        return super().run(*arguments, **more)


def test_a_link_lost_at_any_call_is_resumed_and_undone_to_what_was(loaded: Loaded, targets: Targets, tmp_path: Path) -> None:
    book, lost = loaded(THREE), 0
    for calls in range(0, 40, 2):
        root, journal = tmp_path / f"machine{calls}", tmp_path / f"journal{calls}"
        root.mkdir()
        first = play(book, {"robot": Cut(calls)}, {"root": str(root)}, journal=journal)
        if first.state == "done":
            break
        lost += 1
        assert (first.state, first.exit_code, first.next_command) == ("unreachable", 3, "lupin transport")
        again = play(book, targets, resume=True, journal=journal)
        assert again.state == "done" and (root / "link").read_text() == "hello\n", again.message
        assert undo(find_run(again.run, journal), targets, journal=journal).state == "done"
        assert tree(root) == {}
    assert lost >= 5


def test_a_run_that_is_asked_to_stop_stops_between_steps(loaded: Loaded, targets: Targets, root: Path, tmp_path: Path) -> None:
    stop, journal = threading.Event(), tmp_path / "journal"

    def after_first(event: Event) -> None:
        if event.kind == "step-end":
            stop.set()

    result = play(loaded(THREE), targets, {"root": str(root)}, journal=journal, on_event=after_first, stop=stop)
    assert (result.state, result.exit_code, len(result.steps)) == ("interrupted", 130, 1)
    assert play(loaded(THREE), targets, resume=True, journal=journal).state == "done"


def test_secrets_and_telltale_output_are_not_written_down(loaded: Loaded, targets: Targets, root: Path, tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    book = loaded(
        f"vars: {{key: {{type: secret}}}}\nsteps:\n- name: A\n"
        f"  command: {{run: 'echo got {{{{ key }}}} and wifi.psk=other-thing; touch {root}/a; exit 1', creates: {root}/b}}"
    )
    result = play(book, targets, {"key": "correct-horse"}, journal=journal)
    text = next(journal.iterdir()).read_text()
    assert "got ***" in text and "wifi.psk=***" in text
    assert "correct-horse" not in text + result.message and "other-thing" not in text
    assert (next(journal.iterdir()).stat().st_mode & 0o777) == 0o600
    with pytest.raises(PlaybookError, match=r"give them again: -v key=\.\.\."):
        play(book, targets, resume=True, journal=journal)


def test_of_a_step_that_prints_a_hundred_megabytes_the_journal_keeps_both_ends(
    loaded: Loaded, targets: Targets, root: Path, tmp_path: Path
) -> None:
    much = f"echo begun; head -c 100000000 /dev/zero | tr '\\\\0' x; echo; echo ended; touch {root}/done"
    book = loaded(f'steps:\n- name: much\n  command: {{run: "{much}", creates: {root}/done}}\n')
    heard: list[int] = []
    result = play(book, targets, journal=tmp_path / "j", on_event=lambda e: heard.append(len(e.text)))
    assert result.state == "done", result.message
    run = find_run(result.run, tmp_path / "j")
    assert run.path.stat().st_size < 200_000
    (output,) = run.steps[0].outputs
    assert output.startswith("begun\nxxx") and output.endswith("xxx\nended\n") and "characters left out" in output
    assert 100_000_000 < sum(heard) < 100_010_000, "whoever watches sees all of it"


def test_a_torn_last_line_is_tolerated(loaded: Loaded, targets: Targets, root: Path, tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    run = play(loaded(THREE), targets, {"root": str(root)}, journal=journal).run
    path = journal / f"{run}.jsonl"
    whole = path.read_bytes()
    for cut in range(whole.index(b"\n") + 1, len(whole), 7):
        path.write_bytes(whole[:cut])
        record = find_run(run, journal)
        assert record.torn_lines <= 1 and record.state in ("cut off", "done")
        assert len(record.steps) <= 3
    path.write_bytes(whole[: len(whole) - 40])
    assert play(loaded(THREE), targets, resume=True, journal=journal).state == "done"
    lines = path.read_text().splitlines()
    assert json.loads(lines[-1])["event"] == "end" and find_run(run, journal).torn_lines == 1
    path.write_bytes(whole[:10])
    assert list_runs(journal) == []
