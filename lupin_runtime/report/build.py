"""Builds the report of a run: reads the recording, the truth and the score, and writes JSON and page."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from lupin_runtime.atomic_file import read_json_object, write_atomically
from lupin_runtime.bounded_file import MAX_TRAJECTORY_BYTES, read_bounded_text
from lupin_runtime.geometry import Pose2
from lupin_runtime.record.reader import NotARecording, Recording
from lupin_runtime.record.runs import RecordedRun, recorded_run
from lupin_runtime.report.comparison import Comparison, compare, comparison_content
from lupin_runtime.report.link import Link
from lupin_runtime.report.log_builder import RATES_HZ, LogBuilder
from lupin_runtime.report.page import render_comparison, render_page
from lupin_runtime.report.report_json import ReportInput, report_content, to_plain
from lupin_runtime.report.run_log import RunLog, TimedPosition
from lupin_runtime.report.trajectory import write_trajectory

TRAJECTORY_NAME = "trajectory.tum"
TRUTH_NAME = "truth.json"
TRUE_TRAJECTORY_NAME = "truth_trajectory.tum"

_SHOW_EVERY = 500  # messages

Progress = Callable[[str, float | None], None]  # what is done now, and the finished share from 0 to 1 if it is known
Score = Mapping[str, Any] | Callable[[Path], Mapping[str, Any]] | None

# What a message with odd values, or of another type than its topic has in `graph.py`, raises where it is used.
_UNUSABLE = (ArithmeticError, AttributeError, LookupError, TypeError, ValueError)


@dataclass(frozen=True)
class Report:
    """A built report: its data, paths of page and JSON file, and the JSON's content."""

    source: ReportInput
    page: Path
    json: Path
    content: dict[str, Any]

    @property
    def score(self) -> dict[str, Any]:
        """The comparison with the truth; empty if no truth is known."""
        return self.source.score


@dataclass(frozen=True)
class ComparisonReport:
    """A built comparison of two runs: its data, paths of page and JSON file, and the JSON's content."""

    source: Comparison
    page: Path
    json: Path
    content: dict[str, Any]


def build_report(
    run: Path | RecordedRun,
    facts: Mapping[str, Any] | None = None,
    score: Score = None,
    out: Path | None = None,
    progress: Progress = lambda *_: None,
) -> Report:
    """Build `report/report.json` and `report/report.html` of a run, and `trajectory.tum` beside the recording.

    `run` is a run directory, or the result of `find_recorded_run`. `facts` come from the supervisor
    (see `docs/report.md`); `score` is a comparison with the truth, or a function that computes it from the run directory. By
    default both are taken from an earlier report. `out` is another folder for the report. `progress` is told what is done now.

    Raises NotARecording if the recording has no usable data, and OSError.
    """
    files = run if isinstance(run, RecordedRun) else recorded_run(Path(run))
    recordings = files.open()
    log = read_log(recordings, progress)
    if not log.mission and not len(log.trajectory) and log.map is None:
        raise NotARecording(f"{recordings[0].path} holds no mission, no path and no map: there is nothing to report")
    folder = out or files.report_folder
    folder.mkdir(parents=True, exist_ok=True)
    if len(log.trajectory):
        write_trajectory((files.folder if files.folder.is_dir() else folder) / TRAJECTORY_NAME, log.trajectory)
    earlier = read_json_object(folder / "report.json")
    report = ReportInput(
        log,
        facts=to_plain(facts) if facts is not None else earlier.get("facts") or {},
        run_id=files.folder.name,
        recordings=[recording.path.name for recording in recordings],
        damage=[*files.damage(), *(f"{recording.path.name}: {text}" for recording in recordings for text in recording.damage)],
        metadata=recordings[0].metadata,
    )
    if report.fact("target") == "sim":
        log.link = Link()  # there is none: what arrived late or not at all, this computer had no time for
    progress("comparing with the truth" if callable(score) else "writing the report", None)
    # The score function reads the found tags from this file, which is then written again with the score.
    write_atomically(folder / "report.json", json.dumps(to_plain(report_content(report)), indent=1))
    report = with_truth(_scored(report, score, earlier, files.folder), files.folder)
    progress("drawing the page", None)
    final = to_plain(report_content(report))
    write_atomically(folder / "report.json", json.dumps(final, indent=1))
    write_atomically(folder / "report.html", render_page(report))
    return Report(report, folder / "report.html", folder / "report.json", final)


def build_comparison(a: Report, b: Report, out: Path | None = None) -> ComparisonReport:
    """Write the comparison of two runs as page and JSON file, beside the report of `b` or in `out`. Raises OSError."""
    comparison = compare(a.source, b.source)
    content = to_plain(comparison_content(comparison))
    folder = out or b.page.parent
    folder.mkdir(parents=True, exist_ok=True)
    page, file = (folder / f"comparison-with-{a.source.run_id}{suffix}" for suffix in (".html", ".json"))
    write_atomically(file, json.dumps(content, indent=1))
    write_atomically(page, render_comparison(comparison))
    return ComparisonReport(comparison, page, file, content)


def read_log(recordings: Sequence[Recording], progress: Progress = lambda *_: None) -> RunLog:
    """Read the recordings of a run, oldest first. A message that cannot be used is left out, and counted in `damage`."""
    builder = LogBuilder()
    for recording in recordings:
        builder.begin_recording()
        unusable: Counter[str] = Counter()
        for number, item in enumerate(recording.messages(builder.topics, RATES_HZ)):
            try:
                builder.add(item.topic, item.log_ns, item.publish_ns, item.message)
            except _UNUSABLE:
                unusable[item.topic] += 1
            if number % _SHOW_EVERY == 0:  # the total is unknown: a recording has no index of its messages
                progress(f"reading {recording.path.name}: {number} messages", None)
        recording.damage += [f"{topic}: {count} messages with odd values were left out" for topic, count in unusable.items()]
    return builder.build()


def with_truth(report: ReportInput, folder: Path) -> ReportInput:
    """Return the report's input with the simulator's truth, if the run directory has one."""
    truth = read_json_object(folder / TRUTH_NAME)
    if not truth:
        return report
    # The map's origin is the robot's first pose, unless the score has aligned map and world more precisely.
    start = truth.get("start") or {}
    map_from_world = Pose2(*(float(start.get(key, 0.0)) for key in ("x", "y", "yaw"))).inverse()
    if isinstance(aligned := report.score.get("map_from_world"), Mapping):
        map_from_world = Pose2(*(float(aligned.get(key, 0.0)) for key in ("x", "y", "yaw")))
    positions = _positions(folder / TRUE_TRAJECTORY_NAME)
    path = [TimedPosition(stamp_s, *map_from_world.apply(x, y)) for stamp_s, x, y in positions]
    return replace(report, truth=truth, map_from_world=map_from_world, true_path=path)


def _scored(report: ReportInput, score: Score, earlier: Mapping[str, Any], folder: Path) -> ReportInput:
    if not callable(score):
        return replace(report, score=to_plain(score) if score is not None else earlier.get("score") or {})
    try:
        return replace(report, score=to_plain(score(folder)))
    except Exception as error:
        # Any error of a score function must not cost the report; the page names the error.
        problem = f"The run could not be compared with the truth: {type(error).__name__}: {error}"
        return replace(report, damage=[*report.damage, problem])


def _positions(path: Path) -> list[TimedPosition]:
    """Return the position in each line of a TUM file. Invalid lines are skipped: a killed writer leaves an incomplete one."""
    positions = []
    try:
        lines = read_bounded_text(path, MAX_TRAJECTORY_BYTES, errors="replace").splitlines()
    except OSError:
        return []
    for line in lines:
        words = line.split()
        try:
            position = TimedPosition(float(words[0]), float(words[1]), float(words[2]))
        except (IndexError, ValueError):
            continue
        if all(map(math.isfinite, position)):
            positions.append(position)
    return positions
