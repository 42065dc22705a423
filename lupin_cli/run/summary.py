"""The summary of an ended run: its score and its report, as a JSON object for scripts and as lines for people."""

from __future__ import annotations

import json
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

from lupin_cli.exit_codes import SUCCESS
from lupin_cli.safe_console import SafeConsole
from lupin_cli.terminal import work_progress
from lupin_runtime.atomic_file import read_json_object, write_atomically
from lupin_runtime.bounded_file import read_bounded_text
from lupin_runtime.json_text import parse_json
from lupin_runtime.stack.options import Options
from lupin_runtime.stack.runs import Run
from lupin_runtime.stack.stack_runner import Outcome
from lupin_runtime.stack.state_file import unwritable

SCRIPT_FIELDS = (
    "state",
    "tags_total",
    "tags_reachable",
    "tags_found",
    "tags_read",
    "collisions",
    "trajectory_rmse_m",
    "tag_error_median_m",
    "real_time_factor",
    "sim_time_s",
    "wall_time_s",
    "memory_mb",
    "report",
)


def summarize(run: Run, options: Options, outcome: Outcome, console: SafeConsole) -> dict[str, Any]:
    """Build the report of the run, score a simulated run, and print both; return the object for `--json`."""
    result: dict[str, Any] = dict.fromkeys(SCRIPT_FIELDS)
    result.update(state=outcome.state, wall_time_s=outcome.wall_time_s, memory_mb=outcome.memory_mb)
    simulator = read_json_object(run.path / "sim_state.json")
    result.update(
        collisions=simulator.get("collisions"),
        real_time_factor=simulator.get("real_time_factor"),
        sim_time_s=simulator.get("sim_time_s"),
    )
    _write(run, outcome, result, console)  # before the report, which takes seconds: an interrupt or a defect leaves the result
    if run.recording.exists():
        _report(run, options, outcome, result, console)
        _write(run, outcome, result, console)
    _print(run, outcome, result, console)
    return result


def _write(run: Run, outcome: Outcome, result: dict[str, Any], console: SafeConsole) -> None:
    try:
        write_atomically(run.path / "result.json", json.dumps({**result, "outcome": asdict(outcome)}, indent=1, default=str))
    except OSError as error:
        console.print(unwritable(run, error), style="yellow", soft_wrap=True)


def _report(run: Run, options: Options, outcome: Outcome, result: dict[str, Any], console: SafeConsole) -> None:
    from lupin_runtime.record.reader import NotARecording
    from lupin_runtime.report.build import build_report

    started = time.monotonic()
    facts = {**asdict(outcome), "options": options.as_json(), **{key: result[key] for key in SCRIPT_FIELDS}}
    try:
        with work_progress() as show:
            report = build_report(run.path, facts=facts, score=score_run if options.simulated else None, progress=show)
    except (NotARecording, OSError) as error:
        console.print(f"no report: {error}", style="yellow", soft_wrap=True)
        return
    result.update({key: value for key, value in report.score.items() if key in SCRIPT_FIELDS})
    result["report"] = str(report.page)
    console.print(f"report in {time.monotonic() - started:.1f} s", style="dim")


def score_run(folder: Path) -> dict[str, Any]:
    """Compare the results of a simulated run with the ground truth that the simulator wrote into its directory.

    Reads truth.json, truth_trajectory.tum, trajectory.tum and report/report.json. Raises OSError, ValueError.
    """
    from lupin_runtime.geometry import Pose2
    from lupin_sim.scoring import EstimatedTag, read_tum, score

    found = parse_json(read_bounded_text(folder / "report" / "report.json"))["tags"]
    tags = [
        EstimatedTag(
            id=int(tag["id"]),
            x=tag["x"],
            y=tag["y"],
            read=tag["outcome"] == "read",
            species=(tag["flowers"] or {}).get("species", ""),
            anomaly=bool((tag["flowers"] or {}).get("anomaly")),
        )
        for tag in found
        if tag["x"] is not None and str(tag["id"]).isdigit()
    ]
    figures = score(
        parse_json(read_bounded_text(folder / "truth.json")),
        read_tum(folder / "truth_trajectory.tum"),
        read_tum(folder / "trajectory.tum"),
        tags,
    )
    map_from_world = Pose2(*figures.world_from_map).inverse()
    return {
        **figures.as_json(),
        "map_from_world": {"x": map_from_world.x, "y": map_from_world.y, "yaw": map_from_world.yaw},
    }


def _print(run: Run, outcome: Outcome, result: dict[str, Any], console: SafeConsole) -> None:
    style = "bold green" if outcome.exit_status == SUCCESS else "bold red"
    console.print(outcome.sentence, style=style)
    for death in outcome.deaths:
        if death["ends_run"]:
            continue  # the sentence has said it
        console.print(f"  {death['stage']} {death['status']}: {death['consequence']}", style="yellow")
    for name in SCRIPT_FIELDS[1:]:
        value = result[name]
        if value is not None:
            text = f"{value:.3f}" if isinstance(value, float) else str(value)
            console.print(f"  {name:19s} {text}", soft_wrap=True)
    if outcome.failed_process:
        console.print(f"  next: lupin logs {outcome.failed_process} --run {run.id}", soft_wrap=True)
