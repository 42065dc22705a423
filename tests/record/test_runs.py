from __future__ import annotations

import os
from pathlib import Path

import pytest

from lupin_runtime.record.reader import MAGIC, NotARecording
from lupin_runtime.record.runs import RunNotFound, find_run, run_files


@pytest.fixture
def runs(tmp_path) -> Path:
    """Three runs, the last without a recording."""
    for age, name in enumerate(("20260102-aa", "20260101-ab", "20260103-ba")):
        folder = tmp_path / name
        folder.mkdir()
        if name != "20260103-ba":
            (folder / "recording.mcap").write_bytes(MAGIC)
            os.utime(folder / "recording.mcap", (1000 - age, 1000 - age))
    return tmp_path


def test_the_latest_run_is_the_one_recorded_last(runs):
    assert find_run("latest", runs).folder.name == "20260102-aa"


def test_a_run_is_found_by_its_id_or_an_unambiguous_beginning(runs):
    assert find_run("20260101-ab", runs).folder.name == "20260101-ab"
    assert find_run("20260102", runs).folder.name == "20260102-aa"


def test_an_ambiguous_or_unknown_name_lists_the_candidates(runs):
    with pytest.raises(RunNotFound, match="2 runs begin with it; they are: 20260102-aa, 20260101-ab"):
        find_run("2026010", runs)
    with pytest.raises(RunNotFound, match="no file and no run has this name"):
        find_run("nonsense", runs)
    with pytest.raises(RunNotFound, match="no run was recorded yet"):
        find_run("latest", runs / "nowhere")


def test_a_lone_file_keeps_its_report_beside_it(tmp_path):
    (tmp_path / "drive.mcap").write_bytes(MAGIC)
    run = find_run(str(tmp_path / "drive.mcap"))
    assert run.recordings == (tmp_path / "drive.mcap",)
    assert run.report_folder == tmp_path / "drive-report" / "report"


def test_a_restarted_recorder_left_several_files_in_order(tmp_path):
    for name in ("recording.mcap", "recording-2.mcap", "recording-10.mcap", "other.mcap"):
        (tmp_path / name).write_bytes(MAGIC)
    names = [path.name for path in run_files(tmp_path).recordings]
    assert names == ["recording.mcap", "recording-2.mcap", "recording-10.mcap"]


def test_a_run_opens_what_is_readable_and_fails_only_when_nothing_is(tmp_path):
    (tmp_path / "recording.mcap").write_bytes(b"")
    with pytest.raises(NotARecording, match="empty"):
        run_files(tmp_path).open()
    (tmp_path / "recording-1.mcap").write_bytes(MAGIC)
    assert [r.path.name for r in run_files(tmp_path).open()] == ["recording-1.mcap"]
    with pytest.raises(NotARecording, match="holds no recording"):
        run_files(tmp_path / "none").open()
