"""The probes of a run's steps run in one batch; an output is used until something may have changed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.connection.base import HostKeyUnknown, Output
from lupin_cli.connection.local import LocalTarget
from lupin_cli.operations.base import OperationError, probe_script
from lupin_cli.playbook import Playbook, play, probe_batch
from lupin_cli.playbook.probe_batch import ProbeBatch

LoadPlaybook = Callable[..., Playbook]

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
- name: three, if one is new
  when: one.changed
  file: {path: "{{ root }}/three", content: "3"}
"""


class CountingTarget(LocalTarget):
    """This machine. `batches` has the number of scripts in each batch."""

    def __init__(self) -> None:
        super().__init__("robot")
        self.batches: list[int] = []

    def batch(self, scripts: Any, timeout_s: float = 10.0) -> dict[str, Output]:
        self.batches.append(len(scripts))
        return super().batch(scripts, timeout_s)


def test_run_without_changes_is_one_batch(load_playbook: LoadPlaybook, tmp_path: Path) -> None:
    playbook, root, journal = load_playbook(TWO_FILES), tmp_path / "machine", tmp_path / "journal"
    root.mkdir()
    for name, text in (("one", "1"), ("two", "2")):
        (root / name).write_text(text)
    robot = CountingTarget()
    result = play(playbook, {"robot": robot}, {"root": str(root)}, journal=journal)
    assert [step.state for step in result.steps] == ["same", "same", "same", "skipped"], result.message
    assert robot.batches == [2]  # two files; one of them is in two steps


def test_changed_file_is_examined_again(load_playbook: LoadPlaybook, tmp_path: Path) -> None:
    playbook, root, journal = load_playbook(TWO_FILES), tmp_path / "machine", tmp_path / "journal"
    root.mkdir()
    (root / "two").write_text("2")
    robot = CountingTarget()
    result = play(playbook, {"robot": robot}, {"root": str(root)}, journal=journal)
    # The third step's file did not exist when the probes were fetched; by its turn it does.
    assert [step.state for step in result.steps] == ["changed", "same", "same", "changed"], result.message


def test_step_sees_what_the_step_before_changed(load_playbook: LoadPlaybook, tmp_path: Path) -> None:
    note = tmp_path / "note"
    note.write_text("as wanted")
    body = f"""
steps:
- name: overwrite it
  command: {{run: "echo other > {note}", unless: "grep -q other {note}"}}
- name: as wanted
  file: {{path: "{note}", content: "as wanted"}}
"""
    result = play(load_playbook(body), {"robot": LocalTarget("robot")}, journal=tmp_path / "journal")
    assert [step.state for step in result.steps] == ["changed", "changed"]
    assert note.read_text() == "as wanted"


ONE, TWO = (probe_script(f"echo {n}") for n in (1, 2))


def test_output_is_used_once_by_its_own_step() -> None:
    robot = CountingTarget()
    probes = ProbeBatch(robot)
    probes.fetch({0: ONE, 1: ONE, 2: TWO})
    outputs = [probes.take(index, script) for index, script in ((0, ONE), (2, TWO), (1, ONE))]
    assert [output.stdout for output in outputs if output is not None] == ["1\n", "2\n", "1\n"]
    assert robot.batches == [2]
    assert probes.take(0, ONE) is None


def test_output_of_another_script_is_not_used() -> None:
    probes = ProbeBatch(CountingTarget())
    probes.fetch({0: ONE, 1: TWO})
    assert probes.take(0, TWO) is None


def test_single_probe_is_not_fetched() -> None:
    robot = CountingTarget()
    probes = ProbeBatch(robot)
    probes.fetch({0: ONE})
    assert (robot.batches, probes.take(0, ONE)) == ([], None)


@pytest.mark.parametrize(
    "step",
    [
        "command: {run: 'echo x >> NOTE', unless: '[ $(wc -l < NOTE) -ge 3 ]'}",
        "file: {path: NOTE, content: changed}",
        "file: {path: NOTE, present: false}",
    ],
)
def test_change_discards_the_outputs(step: str, load_playbook: LoadPlaybook, tmp_path: Path) -> None:
    note = tmp_path / "note"
    note.write_text("1\n2\n")
    body = f"steps:\n- name: change\n  {step}\n- name: two\n  file: {{path: NOTE, content: '2'}}\n".replace("NOTE", str(note))
    robot = CountingTarget()
    result = play(load_playbook(body), {"robot": robot}, journal=tmp_path / "journal")
    assert [each.state for each in result.steps] == ["changed", "changed"], result.message
    # Verification of both changes, and the second step's own probe.
    assert robot.batches[1:] == [1, 1, 1] and note.read_text() == "2"


def test_old_output_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(probe_batch, "MAX_AGE_S", -1.0)
    probes = ProbeBatch(CountingTarget())
    probes.fetch({0: ONE, 1: TWO})
    assert probes.take(0, ONE) is None


def test_probe_without_an_answer_is_not_used() -> None:
    robot = CountingTarget()
    probes = ProbeBatch(robot)
    slow = probe_script("sleep 30", timeout_s=1.0)
    probes.fetch({0: slow, 1: ONE})
    output = probes.take(1, ONE)
    assert output is not None and output.ok
    assert robot.batches == [2]
    assert probes.take(0, slow) is None


def test_connection_error_is_raised_once_by_the_first_step(load_playbook: LoadPlaybook, tmp_path: Path) -> None:
    class UnknownKeyTarget(LocalTarget):
        batches = 0

        def batch(self, *_arguments: Any, **_options: Any) -> Any:
            UnknownKeyTarget.batches += 1
            raise HostKeyUnknown("robot shows a key, which was not accepted yet", "lupin robots check")

    result = play(
        load_playbook(TWO_FILES), {"robot": UnknownKeyTarget("robot")}, {"root": str(tmp_path)}, journal=tmp_path / "journal"
    )
    assert (result.state, result.next_command, UnknownKeyTarget.batches) == ("unreachable", "lupin robots check", 1)


def test_probes_are_fetched_but_not_with_until(load_playbook: LoadPlaybook, tmp_path: Path) -> None:
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
    robot = CountingTarget()
    result = play(load_playbook(body), {"robot": robot}, journal=tmp_path / "journal")
    assert [step.result.get("stdout") for step in result.steps] == ["1", "2", "3"], result.message
    assert robot.batches == [2, 1]


def test_local_work_runs_while_the_robot_answers() -> None:
    done: list[str] = []

    def fail() -> None:
        raise OperationError("the step raises it again")

    ProbeBatch(LocalTarget("robot")).fetch({0: ONE, 1: TWO}, [fail, lambda: done.append("work")])
    assert done == ["work"]
