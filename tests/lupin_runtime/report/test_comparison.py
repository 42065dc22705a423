"""The comparison of the synthetic mission with its first two thirds: figures, tags, findings, JSON, page and lines."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from lupin_runtime.report import ComparisonReport, Report, build_comparison, build_report, comparison_lines

from .conftest import HOSTILE, facts, make_run, score  # isort: skip
from .test_report import Page  # isort: skip


@pytest.fixture(scope="module")
def whole(mission_run: Path) -> Report:
    return build_report(mission_run, facts(), score)


@pytest.fixture(scope="module")
def interrupted(mission_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Report:
    """Return the report of a run that ended early, with a collision, and whose computer was slow."""
    folder = tmp_path_factory.mktemp("runs") / "20260315-101500-9f9f"
    folder.mkdir()
    recorded = (mission_run / "recording.mcap").read_bytes()
    (folder / "recording.mcap").write_bytes(recorded[: len(recorded) * 2 // 3])
    for name in ("truth.json", "truth_trajectory.tum"):
        shutil.copy(mission_run / name, folder / name)
    changed = {"state": "INTERRUPTED", "collisions": 1, "real_time_factor": 0.7, "deaths": []}
    return build_report(folder, facts() | changed, lambda _: {"map_from_world": {"x": 0.0, "y": 0.0, "yaw": 0.0}})


@pytest.fixture(scope="module")
def built(whole: Report, interrupted: Report, tmp_path_factory: pytest.TempPathFactory) -> ComparisonReport:
    return build_comparison(whole, interrupted, tmp_path_factory.mktemp("out"))


def test_comparison_names_both_runs_and_caveats(built: ComparisonReport) -> None:
    content = json.loads(built.json.read_text())
    assert content["schema"] == "lupin-comparison/1"
    assert [content[side]["state"] for side in ("a", "b")] == ["DONE", "INTERRUPTED"]
    assert content["b"]["id"] == "20260315-101500-9f9f"
    assert content["caveats"] == ["The report of B is incomplete."]
    assert built.page.name == "comparison-with-20260314-092653-0a1b.html"


def test_figures_have_difference_and_better_run(built: ComparisonReport) -> None:
    rows = {row["name"]: row for row in built.content["figures"]}
    assert (rows["collisions"]["a"], rows["collisions"]["b"], rows["collisions"]["difference"]) == (0.0, 1.0, 1.0)
    assert rows["collisions"]["better"] == "A"
    assert rows["tags_read"]["better"] == rows["real_time_factor"]["better"] == "A"
    assert rows["real_time_factor"]["difference"] == pytest.approx(-0.34)
    assert rows["mission_s"]["better"] is None  # a shorter mission is not better
    assert (rows["score_trajectory_rmse_m"]["b"], rows["score_trajectory_rmse_m"]["difference"]) == (None, None)
    assert (rows["memory_mb"]["difference"], rows["memory_mb"]["better"]) == (0.0, None)
    assert rows["least_clearance_m"]["unit"] == "cm"


def test_tags_are_paired_and_marked_where_they_differ(built: ComparisonReport) -> None:
    tags = {tag["id"]: tag for tag in built.content["tags"]}
    assert list(tags) == ["1", "2", "3", "7", "9", "12", "13", "21"]
    assert tags["3"]["a"] == tags["3"]["b"] | {"error_m": tags["3"]["a"]["error_m"]}
    assert tags["3"]["differs"] is False
    assert tags["12"]["a"]["outcome"] == "read"
    assert tags["12"]["b"]["outcome"] != "read"
    assert tags["12"]["differs"] is True


def test_findings_are_shared_if_only_numbers_differ(built: ComparisonReport) -> None:
    runs = {finding["title"]: finding["runs"] for finding in built.content["findings"]}
    assert runs["E-stop pressed"] == ["A", "B"]
    assert runs["twin was killed by SIGKILL"] == runs["No collision"] == ["A"]
    assert runs["1 collision"] == runs["Slower than real time: 0.70×"] == ["B"]
    severities = [finding["severity"] for finding in built.content["findings"]]
    assert severities == sorted(severities, key=("error", "warn", "note", "good").index)


def test_comparison_page_is_well_formed_and_fetches_nothing(built: ComparisonReport) -> None:
    text = built.page.read_text()
    page = Page(text)
    assert page.open == page.fetched == page.handlers == []
    assert page.scripts == 2
    assert len(page.ids) == len(set(page.ids))
    assert "default-src 'none'" in text
    words = " ".join(page.texts)
    for expected in ("20260314-092653-0a1b", "Interrupted", "Tags read", "Only in B", "1 collision"):
        assert expected in words


def test_comparison_lines_show_figures_and_differences(built: ComparisonReport) -> None:
    lines = comparison_lines(built.source)
    assert lines[0] == "The report of B is incomplete."
    assert any(line.split() == ["Outcome", "DONE", "INTERRUPTED"] for line in lines)
    assert any(line.startswith("Collisions") and line.endswith("+1, A is better") for line in lines)
    assert any(line.startswith("tag 12: read at 2:42") for line in lines)
    assert "only B: 1 collision" in lines


def test_hostile_text_is_escaped_in_the_comparison(tmp_path: Path, whole: Report) -> None:
    make_run(tmp_path / "run", hostile=True)
    hostile = build_report(tmp_path / "run", {**facts(), "state": HOSTILE, "options": {"world": HOSTILE, "target": "sim"}}, {})
    text = build_comparison(hostile, whole, tmp_path).page.read_text()
    assert Page(text).open == []
    assert "<script>alert" not in text
    assert text.lower().count("</script>") == 2
    assert HOSTILE in " ".join(Page(text).texts)


def test_runs_without_any_data_can_be_compared(tmp_path: Path, whole: Report) -> None:
    from tests.support.hostile_samples import write_recording

    write_recording(tmp_path / "recording.mcap")
    bare = build_report(tmp_path)
    built = build_comparison(bare, whole, tmp_path / "out")
    assert "Not recorded: A: the recording has no transforms of the robot." in "".join(Page(built.page.read_text()).texts)
    assert [row["a"] for row in built.content["figures"] if row["name"] == "collisions"] == [None]
