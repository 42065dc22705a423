"""Runs are found by a part of their id; an error names the command that helps in the present situation."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

import pytest

from lupin_runtime.stack.runs import Run, RunError, choose_id, create_run, find_live_run, find_run


def test_unknown_run_names_what_can_be_chosen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    for find in (find_live_run, find_run):
        with pytest.raises(RunError, match="start one with: lupin up"):
            find("x")
    run, lock = create_run()
    other, other_lock = create_run()
    assert find_live_run(run.id) == run == find_run(run.id)
    with pytest.raises(RunError, match=f"of the runs that are up, no run has 'mistyped' in its id; .*{run.id}"):
        find_live_run("mistyped")
    with pytest.raises(RunError, match=f"no run has 'mistyped' in its id; the newest: .*{run.id}"):
        find_run("mistyped")
    with pytest.raises(RunError, match="several runs are up"):
        find_live_run()
    os.close(other_lock)
    assert find_live_run() == run == find_run()
    os.close(lock)
    assert not run.is_live() and not other.is_live()
    with pytest.raises(RunError, match="no run is up; start one with: lupin up"):
        find_live_run(run.id)


IDS = ["20260101-101010-ab12", "20260101-111111-cd34", "20260102-101010-ab56"]


@pytest.mark.parametrize(
    ("name", "chosen"),
    [("latest", IDS[2]), ("cd34", IDS[1]), ("20260102", IDS[2]), ("ab1", IDS[0]), (IDS[1], IDS[1]), ("111111-c", IDS[1])],
)
def test_run_is_named_by_any_unique_part_of_its_id(name: str, chosen: str) -> None:
    assert choose_id(name, IDS) == chosen


def test_ambiguous_name_lists_the_candidates_newest_first() -> None:
    with pytest.raises(RunError, match=f"2 runs have 'ab' in their ids; type more of one: {IDS[2]}, {IDS[0]}"):
        choose_id("ab", IDS)
    with pytest.raises(RunError, match="3 runs have '' in their ids"):
        choose_id("", IDS)
    many = [f"{number:03d}" for number in range(50)]
    with pytest.raises(RunError, match=r"the newest: 049, .*, 040, …$"):
        choose_id("x", many)


def test_id_that_is_part_of_another_can_be_chosen() -> None:
    assert choose_id("a1", ["a1", "a12"]) == "a1"
    assert choose_id("latest", ["latest", "b"]) == "b", "latest is the newest, whatever the runs are called"


def test_two_commands_do_not_take_each_other_for_a_supervisor(tmp_path: Path) -> None:
    run = Run(tmp_path)
    (tmp_path / "lock").touch()
    other_command = os.open(tmp_path / "lock", os.O_RDONLY)
    fcntl.flock(other_command, fcntl.LOCK_SH)  # as `is_live` of another command holds it for an instant
    assert not run.is_live()
    os.close(other_command)
