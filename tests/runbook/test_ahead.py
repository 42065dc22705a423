"""What steps look at first is asked in one batch; an answer counts until something may have changed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.operations.base import OperationError
from lupin_cli.runbook import Playbook, ahead, play
from lupin_cli.runbook.ahead import AskedAhead
from lupin_cli.target.base import HostKeyUnknown, Output, Script
from lupin_cli.target.local import LocalTarget

Loaded = Callable[..., Playbook]

TWO_FILES = """
vars: {root: {type: text}}
steps:
- name: one
  as: one
  file: {path: "{{ root }}/one", content: "1"}
- name: two
  file: {path: "{{ root }}/two", content: "2"}
- name: one once more
  file: {path: "{{ root }}/one", content: "1"}
- name: three, where one is new
  when: one.changed
  file: {path: "{{ root }}/three", content: "3"}
"""


class Counted(LocalTarget):
    """This machine, and how often it was asked how many questions."""

    def __init__(self) -> None:
        super().__init__("robot")
        self.batches: list[int] = []

    def batch(self, scripts: Any, bound_s: float = 10.0) -> dict[str, Output]:
        self.batches.append(len(scripts))
        return super().batch(scripts, bound_s)


def test_a_run_with_nothing_to_do_asks_once(loaded: Loaded, tmp_path: Path) -> None:
    book, root, journal = loaded(TWO_FILES), tmp_path / "machine", tmp_path / "journal"
    root.mkdir()
    for name, text in (("one", "1"), ("two", "2")):
        (root / name).write_text(text)
    robot = Counted()
    result = play(book, {"robot": robot}, {"root": str(root)}, journal=journal)
    assert [step.state for step in result.steps] == ["same", "same", "same", "skipped"], result.message
    assert robot.batches == [2]  # two files, one of them in two steps


def test_what_changed_since_is_asked_again(loaded: Loaded, tmp_path: Path) -> None:
    book, root, journal = loaded(TWO_FILES), tmp_path / "machine", tmp_path / "journal"
    root.mkdir()
    (root / "two").write_text("2")
    robot = Counted()
    result = play(book, {"robot": robot}, {"root": str(root)}, journal=journal)
    # The third step's file was not there when it was asked ahead; by its turn it is.
    assert [step.state for step in result.steps] == ["changed", "same", "same", "changed"], result.message
    assert robot.batches[0] == 2


def test_what_a_step_does_to_the_next_ones_file_is_seen_by_it(loaded: Loaded, tmp_path: Path) -> None:
    note = tmp_path / "note"
    note.write_text("as wanted")
    body = f"""
steps:
- name: spoil it
  command: {{run: "echo spoilt > {note}", unless: "grep -q spoilt {note}"}}
- name: as wanted
  file: {{path: "{note}", content: "as wanted"}}
"""
    result = play(loaded(body), {"robot": LocalTarget("robot")}, journal=tmp_path / "journal")
    assert [step.state for step in result.steps] == ["changed", "changed"]
    assert note.read_text() == "as wanted"


ONE, TWO = (Script("look", f"echo {n}") for n in (1, 2))


def asks(script: Script) -> Callable[[Any], Any]:
    return lambda target: target.batch([script])


def test_an_answer_is_given_as_often_as_it_was_asked_for(tmp_path: Path) -> None:
    robot = Counted()
    target = AskedAhead(robot)
    target.ask([asks(ONE), asks(ONE), asks(TWO)])
    assert [target.batch([script])["look"].stdout for script in (ONE, TWO, ONE)] == ["1\n", "2\n", "1\n"]
    assert robot.batches == [2]
    assert target.batch([ONE])["look"].stdout == "1\n"
    assert robot.batches == [2, 1]


@pytest.mark.parametrize("change", [lambda t, _: t.run("true"), lambda t, p: t.put(str(p / "x"), b""), lambda t, _: t.forget()])
def test_after_a_change_nothing_counts_any_more(tmp_path: Path, change: Callable[[Any, Path], Any]) -> None:
    robot = Counted()
    target = AskedAhead(robot)
    target.ask([asks(ONE), asks(TWO)])
    change(target, tmp_path)
    target.batch([ONE])
    assert robot.batches == [2, 1]


def test_an_old_answer_is_not_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ahead, "FRESH_S", -1.0)
    robot = Counted()
    target = AskedAhead(robot)
    target.ask([asks(ONE), asks(TWO)])
    target.batch([ONE])
    assert robot.batches == [2, 1]


def test_what_got_no_answer_in_time_is_asked_again() -> None:
    robot = Counted()
    target = AskedAhead(robot)
    slow = Script("look", "sleep 30", timeout_s=1.0)
    target.ask([asks(slow), asks(ONE)])
    assert target.batch([ONE])["look"].ok
    assert robot.batches == [2]
    assert target.batch([slow])["look"].status is None
    assert robot.batches == [2, 1]


def test_whoever_is_kept_out_is_told_once_by_the_first_step(loaded: Loaded, tmp_path: Path) -> None:
    class Strange(LocalTarget):
        asked = 0

        def batch(self, *arguments: Any, **options: Any) -> Any:
            Strange.asked += 1
            raise HostKeyUnknown("robot shows a key that nobody has accepted", "lupin robots check")

    result = play(loaded(TWO_FILES), {"robot": Strange("robot")}, {"root": str(tmp_path)}, journal=tmp_path / "journal")
    assert (result.state, result.next_command, Strange.asked) == ("unreachable", "lupin robots check", 1)


def test_a_probe_is_asked_ahead_too_and_what_is_waited_for_is_not(loaded: Loaded, tmp_path: Path) -> None:
    body = """
steps:
- name: look
  as: one
  probe: {run: echo 1}
- name: look there
  as: two
  probe: {run: echo 2}
- name: wait
  as: three
  until: three.number == 3
  probe: {run: echo 3}
"""
    robot = Counted()
    result = play(loaded(body), {"robot": robot}, journal=tmp_path / "journal")
    assert [step.result.get("stdout") for step in result.steps] == ["1", "2", "3"], result.message
    assert robot.batches == [2, 1]


def test_this_machines_work_is_done_while_the_robot_answers() -> None:
    done: list[str] = []

    def fails() -> None:
        raise OperationError("told by its step")

    AskedAhead(LocalTarget("robot")).ask([asks(ONE), asks(TWO)], [fails, lambda: done.append("work")])
    assert done == ["work"]
