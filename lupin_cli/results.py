"""What is left of a run: score, report, the object for scripts and the words for people."""

from __future__ import annotations

import json
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from lupin_runtime.stack.runs import Run
from lupin_runtime.stack.session import Outcome
from lupin_runtime.stack.table import Options

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


def conclude(run: Run, options: Options, outcome: Outcome, console: Console) -> dict[str, Any]:
    """Score the run where the truth is known, build its report, print both; returns the object for `--json`."""
    result: dict[str, Any] = dict.fromkeys(SCRIPT_FIELDS)
    result.update(state=outcome.state, wall_time_s=outcome.wall_time_s, memory_mb=outcome.memory_mb)
    simulator = _read(run.path / "sim_state.json")
    result.update(
        collisions=simulator.get("collisions"),
        real_time_factor=simulator.get("real_time_factor"),
        sim_time_s=simulator.get("sim_time_s"),
    )
    if run.recording.exists():
        _report(run, options, outcome, result, console)
    (run.path / "result.json").write_text(json.dumps({**result, "outcome": asdict(outcome)}, indent=1, default=str))
    _print(run, options, outcome, result, console)
    return result


def _report(run: Run, options: Options, outcome: Outcome, result: dict[str, Any], console: Console) -> None:
    from lupin_sim.scoring import score_run

    from lupin_runtime.report import build_report

    began = time.monotonic()
    facts = {**asdict(outcome), "options": {key: str(value) for key, value in asdict(options).items()}, "result": result}
    with console.status("building the report"):
        report = build_report(run.path, facts=facts, score=(score_run if options.simulated else None))
    result.update({key: value for key, value in (report.score or {}).items() if key in SCRIPT_FIELDS})
    result["report"] = str(report.page)
    console.print(f"report in {time.monotonic() - began:.1f} s", style="dim")


def _read(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text())
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def _print(run: Run, options: Options, outcome: Outcome, result: dict[str, Any], console: Console) -> None:
    style = "bold green" if outcome.exit_status == 0 else "bold red"
    console.print(outcome.sentence, style=style)
    for death in outcome.deaths:
        console.print(f"  {death['stage']} {death['status']}: {death['consequence']}", style="yellow")
    table = Table(box=None, show_header=False, pad_edge=False)
    for name in SCRIPT_FIELDS[1:]:
        if result[name] is not None:
            value = result[name]
            table.add_row(name, f"{value:.3f}" if isinstance(value, float) else str(value))
    console.print(table)
    if outcome.exit_status == 3:
        console.print(f"look closer with: lupin logs --run {run.id}")
