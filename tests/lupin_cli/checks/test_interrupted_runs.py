"""The journal of a playbook that was killed, as the fact reads it."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from lupin_cli.checks.base import Snapshot
from lupin_cli.checks.runs import find_interrupted_runs, format_age
from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Facts
from lupin_cli.facts.link import Link
from lupin_cli.facts.unfinished_runs import UNFINISHED_RUNS, UnfinishedRun
from lupin_cli.playbook.journal import Journal, Mask


def read(state: Path) -> tuple[UnfinishedRun, ...]:
    """Return the fact of a machine with this folder of states."""
    environment = {"PATH": "/usr/bin:/bin", "HOME": "/nonexistent", "XDG_STATE_HOME": str(state)}
    done = subprocess.run(["sh", "-c", UNFINISHED_RUNS.probe], env=environment, capture_output=True, text=True, timeout=60)
    return UNFINISHED_RUNS.parse(Output(done.returncode, done.stdout, done.stderr))


def test_run_is_unfinished_only_after_its_program_ended(tmp_path: Path) -> None:
    assert read(tmp_path) == ()
    folder = tmp_path / "lupin" / "journal"
    journal = Journal.begin(folder, "deploy-robot", "greenhouse", Mask(), {"playbook": "deploy-robot", "robot": "greenhouse"})
    assert read(tmp_path) == ()  # it is being played
    journal.close()
    (run,) = read(tmp_path)
    assert (run.run, run.playbook, run.robot, run.state) == (journal.run, "deploy-robot", "greenhouse", "cut off")
    again = Journal.reopen(journal.path, Mask())
    again.write("end", state="done")
    again.close()
    assert read(tmp_path) == ()


def test_run_whose_undo_has_begun_is_not_to_be_resumed(tmp_path: Path) -> None:
    folder, start = tmp_path / "lupin" / "journal", {"playbook": "deploy-robot", "robot": "greenhouse"}
    journal = Journal.begin(folder, "deploy-robot", "greenhouse", Mask(), start)
    journal.close()
    os.utime(journal.path, (1.0, 1.0))  # the undo is newer
    assert len(read(tmp_path)) == 1
    Journal.begin(folder, "undo-deploy-robot", "greenhouse", Mask(), {**start, "undo_of": journal.run}).close()
    assert read(tmp_path) == ()


@pytest.mark.parametrize(
    ("changes", "closed", "state", "found"),
    [(0, False, "failed", False), (1, False, "failed", True), (2, True, "failed", False), (2, False, "done", False)],
)
def test_failed_run_is_unfinished_only_after_a_change(
    tmp_path: Path, changes: int, closed: bool, state: str, found: bool
) -> None:
    start = {"playbook": "deploy-robot", "robot": "greenhouse"}
    journal = Journal.begin(tmp_path / "lupin" / "journal", "deploy-robot", "greenhouse", Mask(), start)
    for index in range(changes):
        journal.write("change", index=index, summary="s", diff="", before={})
    journal.write("end", state=state, message="m", closed=closed)
    journal.close()
    runs = read(tmp_path)
    assert [(run.state, run.changes) for run in runs] == ([("failed", changes)] if found else [])
    snapshot = Snapshot(Facts("laptop", {"unfinished-runs": runs}), None, Link("greenhouse", "10.42.0.1"))
    for finding in find_interrupted_runs(snapshot):
        assert "failed after 1 change" in finding.cause and finding.fix.command.endswith("--resume")


@pytest.mark.parametrize(("age_s", "text"), [(12, "12 s ago"), (300, "5 min ago"), (7200, "2 h ago"), (400000, "5 days ago")])
def test_age_is_told_as_people_do(age_s: float, text: str) -> None:
    assert format_age(age_s) == text
