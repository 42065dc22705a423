"""From a run directory to its report: reads the recording, the truth and the score, writes JSON and page."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from lupin_runtime.geometry import Pose2
from lupin_runtime.record.reader import NotARecording, Recording
from lupin_runtime.record.runs import RunFiles, run_files
from lupin_runtime.report.collect import RATES_HZ, LogBuilder
from lupin_runtime.report.content import Material, content, plain
from lupin_runtime.report.log import RunLog
from lupin_runtime.report.page import page
from lupin_runtime.report.trajectory import write_trajectory
from lupin_runtime.stack.runs import write_atomically

TRAJECTORY_NAME = "trajectory.tum"
TRUTH_NAME = "truth.json"
TRUE_TRAJECTORY_NAME = "truth_trajectory.tum"

Score = Mapping[str, Any] | Callable[[Path], Mapping[str, Any]] | None


@dataclass(frozen=True)
class Report:
    """A built report: the page, the JSON file and what is in it; `score` is empty where no truth is known."""

    page: Path
    json: Path
    content: dict[str, Any]
    score: dict[str, Any]


def build_report(
    run: Path | RunFiles, facts: Mapping[str, Any] | None = None, score: Score = None, out: Path | None = None
) -> Report:
    """Build `report/report.json` and `report/report.html` of a run, and `trajectory.tum` beside the recording.

    `run` is a run directory, or what `find_run` found. `facts` are what the supervisor knows (see `docs/report.md`), `score`
    is a comparison with the truth or a function of the run directory that makes one; without them an earlier report's are
    kept. `out` is another folder for the report. Raises NotARecording where there is nothing to read, OSError.
    """
    files = run if isinstance(run, RunFiles) else run_files(Path(run))
    recordings = files.open()
    log = read_log(recordings)
    if not log.mission and not len(log.trajectory) and log.map is None:
        raise NotARecording(f"{recordings[0].path} holds no mission, no path and no map: there is nothing to report")
    folder = out or files.report_folder
    folder.mkdir(parents=True, exist_ok=True)
    if len(log.trajectory):
        write_trajectory((files.folder if files.folder.is_dir() else folder) / TRAJECTORY_NAME, log.trajectory)
    earlier = _read_json(folder / "report.json")
    material = Material(
        log,
        facts=plain(facts) if facts is not None else earlier.get("facts") or {},
        run_id=files.folder.name,
        recordings=[recording.path.name for recording in recordings],
        damage=[f"{recording.path.name}: {text}" for recording in recordings for text in recording.damage],
        metadata=recordings[0].metadata,
    )
    # A score compares what was found: it finds the tags in this file, which is written again with the score in it.
    write_atomically(folder / "report.json", json.dumps(plain(content(material)), indent=1))
    material = with_truth(_scored(material, score, earlier, files.folder), files.folder)
    final = plain(content(material))
    write_atomically(folder / "report.json", json.dumps(final, indent=1))
    write_atomically(folder / "report.html", page(material))
    return Report(folder / "report.html", folder / "report.json", final, material.score)


def read_log(recordings: Sequence[Recording]) -> RunLog:
    """One pass over the recordings of a run, oldest first."""
    builder = LogBuilder()
    for recording in recordings:
        for item in recording.messages(builder.topics, RATES_HZ):
            builder.take(item.topic, item.log_ns, item.message)
    return builder.build()


def with_truth(material: Material, folder: Path) -> Material:
    """The material with the simulator's truth from the run directory, where it left one."""
    truth = _read_json(folder / TRUTH_NAME)
    if not truth:
        return material
    # The map begins where the robot stood at first, unless the score has aligned the two better.
    start = truth.get("start") or {}
    map_from_world = Pose2(*(float(start.get(key, 0.0)) for key in ("x", "y", "yaw"))).inverse()
    if isinstance(aligned := material.score.get("map_from_world"), Mapping):
        map_from_world = Pose2(*(float(aligned.get(key, 0.0)) for key in ("x", "y", "yaw")))
    path = [map_from_world.apply(x, y) for x, y in _positions(folder / TRUE_TRAJECTORY_NAME)]
    return replace(material, truth=truth, map_from_world=map_from_world, true_path=path)


def _scored(material: Material, score: Score, earlier: Mapping[str, Any], folder: Path) -> Material:
    if not callable(score):
        return replace(material, score=plain(score) if score is not None else earlier.get("score") or {})
    try:
        return replace(material, score=plain(score(folder)))
    except Exception as error:
        # Whatever a score stumbles over, the report of the run must not be lost with it; the page names the failure.
        problem = f"The run could not be compared with the truth: {type(error).__name__}: {error}"
        return replace(material, damage=[*material.damage, problem])


def _read_json(path: Path) -> dict[str, Any]:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _positions(path: Path) -> list[tuple[float, float]]:
    """(x, y) of a TUM file; lines that are none are passed over, as the last one of a killed writer is."""
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
