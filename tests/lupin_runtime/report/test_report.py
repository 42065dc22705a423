"""The report of the synthetic mission: JSON, page, and incomplete recordings."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import pytest

from lupin_runtime import graph
from lupin_runtime.record.reader import MAGIC, NotARecording, Recording
from lupin_runtime.record.runs import find_recorded_run
from lupin_runtime.record.writer import RecordingWriter
from lupin_runtime.report import Report, build_report
from lupin_runtime.report.build import read_log
from lupin_runtime.report.findings import run_findings
from lupin_runtime.report.page import render_page
from tests.support.hostile_samples import write_recording

from .conftest import HOSTILE, SLOWDOWN, facts, make_run, score  # isort: skip


class Page(HTMLParser):
    """Parses the page: checks that elements nest, and collects what a browser would fetch or run."""

    VOID = frozenset(["meta", "img", "input", "br", "link", "hr"])

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.fetched: list[str] = []
        self.handlers: list[str] = []
        self.scripts = 0
        self.ids: list[str] = []
        self.images: list[dict[str, str]] = []
        self.texts: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        values = {name: value or "" for name, value in attributes}
        self.scripts += tag == "script"
        self.handlers += [name for name in values if name.startswith("on")]
        self.ids += [values["id"]] if "id" in values else []
        self.images += [values] if tag == "img" else []
        for name in ("src", "href", "srcset", "action", "poster", "xlink:href"):
            if name in values and not values[name].startswith(("data:image/", "#")):
                self.fetched.append(values[name])
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in self.VOID:
            assert self.open, f"</{tag}> closes no element"
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] not in ("script", "style"):
            self.texts.append(data)


@pytest.fixture(scope="module")
def built(mission_run: Path) -> Report:
    return build_report(mission_run, facts(), score)


@pytest.fixture(scope="module")
def page(built: Report) -> Page:
    return Page(built.page.read_text())


def test_json_contains_run_and_figures(built: Report) -> None:
    content = json.loads(built.json.read_text())
    assert content["schema"] == "lupin-report/1"
    assert content["run"]["state"] == "DONE"
    assert content["run"]["mission_id"] == "lupin-0a1b2c3d"
    assert content["run"]["started_at"] == "2026-03-14T09:26:53+00:00"
    n = content["figures"]
    assert (n["tags_seen"], n["tags_read"], n["tags_unreachable"]) == (8, 7, 1)
    assert (n["flowers"], n["bugs"], n["health"]) == (28, 2, "critical")
    assert n["distance_m"] == pytest.approx(49.8, abs=1.5)
    assert n["score_trajectory_rmse_m"] == 0.0312
    assert content["map"]["known_area_m2"][-1][1] > 40.0
    assert content["fields"]["co2"]["samples"] == 3


def test_json_contains_every_tag_result(built: Report) -> None:
    tags = {tag["id"]: tag for tag in built.content["tags"]}
    assert list(tags) == ["1", "2", "3", "7", "9", "12", "13", "21"]
    three, lost = tags["3"], tags["21"]
    moisture = next(r for r in tags["2"]["readings"] if r["sensor"] == "soil_moisture")
    assert (moisture["value"], moisture["unit"]) == (22.0, "%")  # the greenhouse gives 0.22
    assert (three["outcome"], three["visited"], three["health"]) == ("read", True, "critical")
    assert (three["x"], three["y"], three["z"]) == pytest.approx((4.41, 0.98, 0.4))
    assert three["facing_rad"] == pytest.approx(1.5708, abs=1e-3)
    assert [(r["sensor"], r["value"], r["unit"]) for r in three["readings"]] == [
        ("humidity", 55.0, "%"),
        ("light", 320.0, "lux"),
        ("co2", 1480.0, "ppm"),
    ]
    assert three["flowers"]["species"] == "tulip_pink"
    assert (three["flowers"]["flower_count"], three["flowers"]["bug_count"], len(three["flowers"]["blooms"])) == (3, 2, 3)
    assert len(three["box_footprint"]) == 4
    assert three["discovered_s"] < three["read_s"]
    assert (lost["outcome"], lost["visited"]) == ("unreachable", False)
    assert lost["reason"] == "the navigator gave up: no free path to the tag was found"


def test_timeline_has_states_legs_flags_and_events(built: Report) -> None:
    line = built.content["timeline"]
    states = [band["label"] for band in line["states"]]
    assert states == ["BOOT", "READY", "PREPARE", "EXPLORING", "MONITORING", "RETURNING", "DONE"]
    assert all(a["to_s"] == b["from_s"] for a, b in pairwise(line["states"]))
    assert [band["label"] for band in line["flags"]] == ["e-stop"]
    texts = [event["text"] for event in line["events"]]
    for expected in ("e-stop pressed", "e-stop released", "tag 3 discovered", "bug seen at tag 3", "navigation retry"):
        assert expected in texts
    assert "tag 21 unreachable: nav_status_6" in texts
    times = [event["t_s"] for event in line["events"]]
    assert times == sorted(times)


def test_findings_are_sorted_and_use_the_truth(built: Report) -> None:
    found = built.content["findings"]
    ranks = [("error", "warn", "note", "good").index(f["severity"]) for f in found]
    assert ranks == sorted(ranks)
    titles = [f["title"] for f in found]
    for expected in ("1 tag never seen", "Bugs at 1 pot", "E-stop pressed", "twin was killed by SIGKILL", "No collision"):
        assert expected in titles
    assert "Tag 21 cannot be reached" in titles  # not "was not reached": the world has no path to it
    assert any("slam_toolbox logged a warning, 3 times" in title for title in titles)


def test_findings_say_what_to_do_when_and_where(built: Report) -> None:
    found = {finding["title"]: finding for finding in built.content["findings"]}
    co2 = found["CO₂ at tag 3 is critical"]
    assert (co2["action"], co2["tag_ids"]) == ("Ventilate the greenhouse", ["3"])
    stop = found["E-stop pressed"]
    assert stop["command"] == f"lupin logs estop --run {built.content['run']['id']}"
    assert 120.0 < stop["t_s"] < 121.0
    assert found["twin was killed by SIGKILL"]["command"].startswith("lupin logs twin --run ")
    wrong = next(finding for title, finding in found.items() if title.startswith("The estimated position was up to"))
    assert 140.0 <= wrong["t_s"] <= 142.0  # between two corrections by the map
    assert "Truth" in wrong["action"]
    assert all(f["action"] for f in found.values() if f["severity"] in ("error", "warn"))


def test_series_show_error_rate_and_clearance_over_time(built: Report) -> None:
    series = built.content["series"]
    error, rate, clearance = (
        series[f"{name}"]["points"] for name in ("localization_error_m", "real_time_factor", "clearance_m")
    )
    assert max(v for t, v in error if t < 139.0) < 0.03
    assert max(v for t, v in error if 140.0 < t < 142.0) == pytest.approx(0.15, abs=0.02)
    assert [v for t, v in rate if 70.0 < t < 88.0] == pytest.approx([SLOWDOWN] * sum(70.0 < t < 88.0 for t, _ in rate))
    assert [v for t, v in rate if t > 100.0] == pytest.approx([1.0] * sum(t > 100.0 for t, _ in rate))
    assert 0.2 < min(v for _, v in clearance) < 0.6
    n = built.content["figures"]
    assert n["least_clearance_m"] == min(v for _, v in clearance)
    assert n["largest_localization_error_m"] == max(v for _, v in error)


def test_missing_quantities_are_named_on_the_page(tmp_path: Path) -> None:
    write_recording(tmp_path / "recording.mcap")
    report = build_report(tmp_path)
    series = report.content["series"]
    missing = {name: quantity["missing"] for name, quantity in series.items() if quantity["points"] is None}
    assert missing["localization_error_m"] == "the recording has no transforms of the robot"
    assert "real_time_factor" in missing
    text = "".join(Page(report.page.read_text()).texts)
    assert all(f"Not recorded: {reason}." in text for reason in missing.values())


@pytest.mark.usefixtures("built")
def test_trajectory_is_written_beside_the_recording(mission_run: Path) -> None:
    rows = [line.split() for line in (mission_run / "trajectory.tum").read_text().splitlines()]
    truth = [line.split() for line in (mission_run / "truth_trajectory.tum").read_text().splitlines()]
    assert len(rows) > 1000
    for row in rows[100::97]:
        nearest = min(truth, key=lambda line: abs(float(line[0]) - float(row[0])))
        assert float(row[1]) == pytest.approx(float(nearest[1]), abs=0.5)
        assert float(row[2]) == pytest.approx(float(nearest[2]), abs=0.5)


def test_page_is_well_formed_and_fetches_nothing(page: Page, built: Report) -> None:
    text = built.page.read_text()
    assert page.open == []
    assert page.fetched == []
    assert page.handlers == []
    assert len(page.ids) == len(set(page.ids))
    assert "{{" not in re.sub(r"<(style|script)[\s\S]*?</\1>", "", text)
    outside = re.sub(r"data:image/[a-z]+;base64,[A-Za-z0-9+/=]+", "", text)
    assert not re.search(r"(?:https?:)?//[a-z0-9]", re.sub(r"^\s*//.*$", "", outside, flags=re.M))
    assert "@import" not in text
    assert "default-src 'none'" in text
    assert len(text) < 3_000_000


def test_page_shows_the_figures(page: Page) -> None:
    text = " ".join(page.texts)
    for expected in (
        "7 of 8 tags read",
        "DONE",
        "2.2 cm",
        "3.1 cm",
        "49.",
        "made-up",
        "lupin-0a1b2c3d",
        "1480",
        "critical high",
    ):
        assert expected in text
    assert all(f"tag-{tag_id}" in page.ids for tag_id in ("1", "3", "21"))
    assert sum("camera at tag" in image.get("alt", "") for image in page.images) >= 5


def test_images_and_drawings_have_text_alternatives(page: Page, built: Report) -> None:
    assert all("alt" in image for image in page.images)
    text = built.page.read_text()
    drawings = re.findall(r"<svg[^>]*>", text)
    assert drawings
    assert all(('role="img"' in d and "aria-label=" in d) or "aria-hidden" in d for d in drawings)
    for control in re.findall(r"<(?:input|button)[^>]*id=[^>]*>", text):
        assert "aria-label=" in control, control


def test_hostile_text_is_escaped(tmp_path: Path) -> None:
    make_run(tmp_path / "run", hostile=True)
    report = build_report(
        tmp_path / "run",
        {**facts(), "sentence": HOSTILE, "state": HOSTILE, "options": {"world": HOSTILE, "target": "sim"}},
        lambda _: {"tags_total": HOSTILE, "tag_errors_m": {HOSTILE: 0.1}},
    )
    text = report.page.read_text()
    page = Page(text)
    assert page.open == []
    assert page.scripts == 2
    assert "<script>alert" not in text
    assert text.lower().count("</style>") == 1
    assert text.lower().count("</script>") == 2
    assert HOSTILE in " ".join(page.texts)


def test_hostile_names_are_escaped_on_the_map(built: Report) -> None:
    truth = {**built.source.truth, "tags": [{**tag, "id": HOSTILE} for tag in built.source.truth["tags"]]}
    processes = {**built.source.facts, "stages": [{"name": HOSTILE, "why": HOSTILE}]}
    source = replace(built.source, run_id=HOSTILE, truth=truth, facts=processes)
    source.tags = [replace(tag, tag_id=f"{HOSTILE} {tag.tag_id}") for tag in source.tags]
    page = Page(render_page(source))
    assert page.open == page.handlers == []
    assert page.scripts == 2
    for expected in (f"True position of tag {HOSTILE}", f"Flower box of tag {HOSTILE} 3", f"Tag {HOSTILE} 21: not reached"):
        assert expected in page.texts
    assert any(text.startswith(f"Pink tulip at tag {HOSTILE} 3") for text in page.texts)
    assert page.texts.count(HOSTILE) == 2  # the process and its reason


def test_tag_that_faces_up_is_drawn_as_a_circle(built: Report) -> None:
    source = replace(built.source)
    source.tags = [replace(tag, pose=tag.pose and replace(tag.pose, facing_rad=None)) for tag in source.tags]
    assert len(re.findall(r'<circle [^>]*class="plate"', render_page(source))) == 2 * 8  # for wide screens and for phones
    assert not re.search(r'<circle [^>]*class="plate"', built.page.read_text())


def test_rebuilt_report_keeps_facts_and_score(built: Report, mission_run: Path) -> None:
    again = build_report(find_recorded_run(str(mission_run)))
    assert again.content["facts"] == built.content["facts"]
    assert again.score == built.score
    same = {k: v for k, v in again.content.items() if k != "run"}
    assert same == {k: v for k, v in built.content.items() if k != "run"}


def test_report_of_a_single_recording_has_no_score(mission_run: Path, tmp_path: Path) -> None:
    lone = tmp_path / "drive.mcap"
    shutil.copy(mission_run / "recording.mcap", lone)
    report = build_report(find_recorded_run(str(lone)))
    assert report.page == tmp_path / "drive-report" / "report" / "report.html"
    assert report.content["score"] is None
    assert "there is no ground truth" in report.content["series"]["localization_error_m"]["missing"]
    assert not any("--run" in finding["command"] for finding in report.content["findings"])  # it has no logs
    assert report.content["run"]["state"] == "DONE"
    assert report.content["figures"]["tags_read"] == 7
    assert Page(report.page.read_text()).open == []
    assert (tmp_path / "drive-report" / "trajectory.tum").exists()


def test_truncated_recording_gives_an_incomplete_report(mission_run: Path, tmp_path: Path) -> None:
    whole = (mission_run / "recording.mcap").read_bytes()
    (tmp_path / "recording.mcap").write_bytes(whole[: len(whole) * 2 // 3])
    report = build_report(tmp_path)
    titles = [finding["title"] for finding in report.content["findings"]]
    assert "This report is incomplete" in titles
    assert report.content["figures"]["recorded_s"] > 0
    assert Page(report.page.read_text()).open == []


def test_failing_score_is_reported_as_a_finding(mission_run: Path, tmp_path: Path) -> None:
    shutil.copy(mission_run / "recording.mcap", tmp_path / "recording.mcap")

    def broken(_: Path) -> dict[str, float]:
        raise ValueError("no truth here")

    report = build_report(tmp_path, facts(), broken)
    details = [finding["detail"] for finding in report.content["findings"]]
    assert any("ValueError: no truth here" in detail for detail in details)
    assert report.page.exists()


def test_empty_recording_error_names_the_file(tmp_path: Path) -> None:
    with pytest.raises(NotARecording, match="holds no recording"):
        build_report(tmp_path)
    (tmp_path / "recording.mcap").write_bytes(MAGIC)
    with pytest.raises(NotARecording, match=r"recording\.mcap holds no mission, no path and no map"):
        build_report(tmp_path)


@pytest.mark.parametrize("rest", [b"", b"\x00" * 8, b"\x05\x01"])
def test_odd_messages_and_trailing_bytes_cost_only_themselves(tmp_path: Path, rest: bytes) -> None:
    write_recording(tmp_path / "whole.mcap")
    writer = RecordingWriter(tmp_path / "odd.mcap")
    odd = writer.add_channel(graph.SCAN.name, "std_msgs/msg/Bool", "bool data", graph.SCAN.qos)
    writer.write(odd, b"\x00\x01\x00\x00\x01", 1, 1)
    writer.flush()
    writer.finish()
    with (tmp_path / "odd.mcap").open("ab") as file:
        file.write(rest)
    recordings = [Recording(tmp_path / "whole.mcap"), Recording(tmp_path / "odd.mcap")]
    log = read_log(recordings)
    assert len(log.scans) == 2 and log.map is not None  # one a second
    assert recordings[0].damage == []
    assert recordings[1].damage == ["/scan: 1 messages with odd values were left out"]


def test_command_for_a_tag_is_quoted_for_the_shell(built: Report) -> None:
    (line,) = [tag for tag in built.source.tags if tag.tag_id == "3"]
    hostile = replace(line, tag_id="3; touch x", outcome="skipped")
    findings = run_findings(built.source.log, [hostile], built.source.timeline, built.source.series, {}, {}, "a b")
    commands = {finding.command for finding in findings}
    assert "lupin mission start '3; touch x'" in commands
    assert "lupin logs --run 'a b' --level warn" in commands
