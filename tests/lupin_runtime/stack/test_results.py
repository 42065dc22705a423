"""The result of a run, from its files as they are after every kind of end, and from damaged ones."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from lupin_runtime.stack.results import NO_RESULT, UP, result_of
from lupin_runtime.stack.runs import Run, create_run
from lupin_runtime.stack.usage import start_ticks

OWN = {"pid": os.getpid(), "start_ticks": start_ticks(os.getpid())}


def ended(folder: Path, outcome: dict[str, Any], **result: Any) -> Run:
    run = Run(folder)
    run.write_info({"started": 1.8e9, "options": {"world": "demo", "mission": True}})
    run.write_state({"outcome": outcome})
    (folder / "result.json").write_text(json.dumps(result))
    return run


def test_done_mission_has_its_tags_duration_and_report(tmp_path: Path) -> None:
    run = ended(tmp_path, {"state": "DONE", "sentence": "mission DONE", "wall_time_s": 61.5}, tags_read=7, tags_found=9)
    run.report.mkdir()
    (run.report / "report.html").touch()
    found = result_of(run)
    assert (found.state, found.why, found.world, found.duration_s) == ("DONE", "", "demo", 61.5)
    assert (found.tags_read, found.tags_total, found.report) == (7, 9, str(run.report / "report.html"))


def test_failed_run_says_why(tmp_path: Path) -> None:
    found = result_of(ended(tmp_path, {"state": "LOST", "sentence": "sim exited with status 1: ValueError"}))
    assert (found.state, found.why) == ("LOST", "sim exited with status 1: ValueError")


def test_killed_run_has_no_result_and_is_not_up(tmp_path: Path) -> None:
    run = Run(tmp_path)
    run.write_state({"age_s": 12.0, "stages": [{"name": "nav", "phase": "up"}]})
    found = result_of(run)
    assert (found.state, found.duration_s) == (NO_RESULT, 12.0)
    assert "killed" in found.why


@pytest.mark.parametrize(
    ("owner", "state"), [(OWN, UP), ({"pid": 2**22, "start_ticks": 1}, NO_RESULT), ({**OWN, "start_ticks": 1}, NO_RESULT)]
)
def test_locked_run_is_up_only_while_its_owner_exists(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, owner: dict[str, Any], state: str
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    run, lock = create_run()
    run.write_info(owner)
    assert result_of(run).state == state
    os.close(lock)


@pytest.mark.parametrize("value", [None, [], {}, "x", -1, True, 1e400, [[]], {"state": 3, "mission": []}])
def test_values_of_the_wrong_kind_are_missing(tmp_path: Path, value: object) -> None:
    run = Run(tmp_path)
    run.write_info({"started": value, "options": value})
    run.write_state({"outcome": value, "age_s": value, "mission": value})
    (tmp_path / "result.json").write_text(json.dumps({"outcome": value, "tags_read": value, "tags_found": value}))
    found = result_of(run)
    assert found.state == NO_RESULT and found.world == ""
    assert found.tags_read is None or type(found.tags_read) is int
    json.dumps(found.as_json(), allow_nan=False)
