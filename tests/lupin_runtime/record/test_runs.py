"""Runs and recordings are found by the names that a user types."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from lupin_runtime.record.reader import MAGIC, NotARecording
from lupin_runtime.record.runs import RecordingNotFound, find_recorded_run, recorded_run


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    """Three runs, the last without a recording."""
    for age, name in enumerate(("20260102-aa", "20260101-ab", "20260103-ba")):
        folder = tmp_path / name
        folder.mkdir()
        if name != "20260103-ba":
            (folder / "recording.mcap").write_bytes(MAGIC)
            os.utime(folder / "recording.mcap", (1000 - age, 1000 - age))
    return tmp_path


def test_latest_is_the_run_recorded_last(runs: Path) -> None:
    assert find_recorded_run("latest", runs).folder.name == "20260102-aa"


def test_run_is_found_by_any_unique_part_of_its_id(runs: Path) -> None:
    assert find_recorded_run("20260101-ab", runs).folder.name == "20260101-ab"
    assert find_recorded_run("20260102", runs).folder.name == "20260102-aa"
    assert find_recorded_run("ab", runs).folder.name == "20260101-ab"


def test_ambiguous_or_unknown_run_name_lists_candidates(runs: Path) -> None:
    with pytest.raises(RecordingNotFound, match="3 runs have '2026010' in their ids; type more of one: 20260103-ba, 20260102"):
        find_recorded_run("2026010", runs)
    with pytest.raises(RecordingNotFound, match="there is no file nonsense, and no run has 'nonsense' in its id"):
        find_recorded_run("nonsense", runs)
    with pytest.raises(RecordingNotFound, match="no run was recorded yet"):
        find_recorded_run("latest", runs / "nowhere")


def test_single_recording_has_its_report_beside_it(tmp_path: Path) -> None:
    (tmp_path / "drive.mcap").write_bytes(MAGIC)
    run = find_recorded_run(str(tmp_path / "drive.mcap"))
    assert run.recordings == (tmp_path / "drive.mcap",)
    assert run.report_folder == tmp_path / "drive-report" / "report"


def test_recordings_of_a_restarted_recorder_are_in_order(tmp_path: Path) -> None:
    for name in ("recording.mcap", "recording-2.mcap", "recording-10.mcap", "other.mcap"):
        (tmp_path / name).write_bytes(MAGIC)
    names = [path.name for path in recorded_run(tmp_path).recordings]
    assert names == ["recording.mcap", "recording-2.mcap", "recording-10.mcap"]


def test_run_opens_its_readable_recordings(tmp_path: Path) -> None:
    (tmp_path / "recording.mcap").write_bytes(b"")
    with pytest.raises(NotARecording, match="empty"):
        recorded_run(tmp_path).open()
    (tmp_path / "recording-1.mcap").write_bytes(MAGIC)
    assert [r.path.name for r in recorded_run(tmp_path).open()] == ["recording-1.mcap"]
    with pytest.raises(NotARecording, match="holds no recording"):
        recorded_run(tmp_path / "none").open()
