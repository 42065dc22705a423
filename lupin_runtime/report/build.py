"""Builds the report of a run: reads the recording, the truth and the score, and writes JSON and page."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from lupin_runtime.atomic_file import write_atomically
from lupin_runtime.geometry import Pose2
from lupin_runtime.record.reader import NotARecording, Recording
from lupin_runtime.record.runs import RecordedRun, recorded_run
from lupin_runtime.report.log_builder import RATES_HZ, LogBuilder
from lupin_runtime.report.page import render_page
from lupin_runtime.report.report_json import ReportInput, report_content, to_plain
from lupin_runtime.report.run_log import RunLog
from lupin_runtime.report.trajectory import write_trajectory

TRAJECTORY_NAME = "trajectory.tum"
TRUTH_NAME = "truth.json"
TRUE_TRAJECTORY_NAME = "truth_trajectory.tum"

Score = Mapping[str, Any] | Callable[[Path], Mapping[str, Any]] | None


@dataclass(frozen=True)
class Report:
    """A built report: paths of page and JSON file, and the JSON's content; `score` is empty if no truth is known."""

    page: Path
    json: Path
    content: dict[str, Any]
    score: dict[str, Any]


def build_report(
    run: Path | RecordedRun, facts: Mapping[str, Any] | None = None, score: Score = None, out: Path | None = None
) -> Report:
    """Build `report/report.json` and `report/report.html` of a run, and `trajectory.tum` beside the recording.

    `run` is a run directory, or the result of `find_recorded_run`. `facts` come from the supervisor
    (see `docs/report.md`); `score` is a comparison with the truth, or a function that computes it from the run directory. By
    default both are taken from an earlier report. `out` is another folder for the report.

    Raises NotARecording if the recording has no usable data, and OSError.
    """
    files = run if isinstance(run, RecordedRun) else recorded_run(Path(run))
    recordings = files.open()
    log = read_log(recordings)
    if not log.mission and not len(log.trajectory) and log.map is None:
        raise NotARecording(f"{recordings[0].path} holds no mission, no path and no map: there is nothing to report")
    folder = out or files.report_folder
    folder.mkdir(parents=True, exist_ok=True)
    if len(log.trajectory):
        write_trajectory((files.folder if files.folder.is_dir() else folder) / TRAJECTORY_NAME, log.trajectory)
    earlier = _read_json(folder / "report.json")
    report = ReportInput(
        log,
        facts=to_plain(facts) if facts is not None else earlier.get("facts") or {},
        run_id=files.folder.name,
        recordings=[recording.path.name for recording in recordings],
        damage=[f"{recording.path.name}: {text}" for recording in recordings for text in recording.damage],
        metadata=recordings[0].metadata,
    )
    # The score function reads the found tags from this file, which is then written again with the score.
    write_atomically(folder / "report.json", json.dumps(to_plain(report_content(report)), indent=1))
    report = with_truth(_scored(report, score, earlier, files.folder), files.folder)
    final = to_plain(report_content(report))
    write_atomically(folder / "report.json", json.dumps(final, indent=1))
    write_atomically(folder / "report.html", render_page(report))
    return Report(folder / "report.html", folder / "report.json", final, report.score)


def read_log(recordings: Sequence[Recording]) -> RunLog:
    """Read the recordings of a run, oldest first."""
    builder = LogBuilder()
    for recording in recordings:
        for item in recording.messages(builder.topics, RATES_HZ):
            builder.add(item.topic, item.log_ns, item.message)
    return builder.build()


def with_truth(report: ReportInput, folder: Path) -> ReportInput:
    """Return the report's input with the simulator's truth, if the run directory has one."""
    truth = _read_json(folder / TRUTH_NAME)
    if not truth:
        return report
    # The map's origin is the robot's first pose, unless the score has aligned map and world more precisely.
    start = truth.get("start") or {}
    map_from_world = Pose2(*(float(start.get(key, 0.0)) for key in ("x", "y", "yaw"))).inverse()
    if isinstance(aligned := report.score.get("map_from_world"), Mapping):
        map_from_world = Pose2(*(float(aligned.get(key, 0.0)) for key in ("x", "y", "yaw")))
    path = [map_from_world.apply(x, y) for x, y in _positions(folder / TRUE_TRAJECTORY_NAME)]
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


def _read_json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def _positions(path: Path) -> list[tuple[float, float]]:
    """Return (x, y) of each line of a TUM file, skipping invalid lines: a killed writer leaves an incomplete last line."""
    positions = []
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError:
        return []
    for line in lines:
        words = line.split()
        try:
            positions.append((float(words[1]), float(words[2])))
        except (IndexError, ValueError):
            continue
    return positions
