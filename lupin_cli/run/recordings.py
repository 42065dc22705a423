"""Open a recorded run, build its report and show the page: shared by `lupin replay` and `lupin report`."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from lupin_cli.exit_codes import FAILURE, USAGE_ERROR
from lupin_cli.terminal import echo, work_progress

if TYPE_CHECKING:
    from lupin_runtime.record.reader import Recording
    from lupin_runtime.record.runs import RecordedRun
    from lupin_runtime.report import ComparisonReport, Report

RUN_HELP = "A recording, a folder of a run or of rosbag2, any unique part of a run's id, or: latest."


def open_run(name: str) -> tuple[RecordedRun, list[Recording]]:
    """Return the recorded run called `name` and its open recordings.

    Exits with status 2 if there is no such run, and with status 1 if no recording is readable.
    """
    from lupin_runtime.record.reader import NotARecording
    from lupin_runtime.record.runs import RecordingNotFound, find_recorded_run

    try:
        run = find_recorded_run(name)
        recordings = run.open()
    except RecordingNotFound as error:
        echo(str(error), err=True)
        raise typer.Exit(USAGE_ERROR) from error
    except NotARecording as error:
        echo(str(error), err=True)
        raise typer.Exit(FAILURE) from error
    for damage in run.damage():
        echo(damage, err=True)
    return run, recordings


def build_run_report(name: str, out: Path | None) -> Report:
    """Build the report of the run called `name`, in the folder `out` or beside the recording.

    Exits if the run is missing or unreadable, or if the report cannot be written.
    """
    from lupin_runtime.record.reader import NotARecording
    from lupin_runtime.report import build_report

    run, _ = open_run(name)
    try:
        with work_progress() as show:
            return build_report(run, facts=_facts(run.folder), score=_score(run.folder), out=out, progress=show)
    except NotARecording as error:
        echo(str(error), err=True)
        raise typer.Exit(FAILURE) from error
    except OSError as error:
        raise _unwritable(error) from error


def build_run_comparison(name_a: str, name_b: str, out: Path | None) -> ComparisonReport:
    """Build the reports of two runs and their comparison, in the folder `out` or beside the second report.

    Exits if a run is missing or unreadable, if both names are of the same run, or if a file cannot be written.
    """
    from lupin_runtime.report import build_comparison

    (run_a, _), (run_b, _) = open_run(name_a), open_run(name_b)
    if run_a == run_b:
        echo(f"{name_a} and {name_b} are the same run, {run_a.folder.name}; see: lupin runs", err=True)
        raise typer.Exit(USAGE_ERROR)
    a, b = (build_run_report(name, None) for name in (name_a, name_b))
    try:
        return build_comparison(a, b, out)
    except OSError as error:
        raise _unwritable(error) from error


def _unwritable(error: OSError) -> typer.Exit:
    echo(f"the report cannot be written: {error}; try another folder with --out", err=True)
    return typer.Exit(FAILURE)


def _facts(folder: Path) -> dict[str, Any] | None:
    """Return the supervisor's facts about an ended run; None without any, in which case an earlier report's facts stay."""
    from lupin_runtime.atomic_file import read_json_object
    from lupin_runtime.json_text import conform
    from lupin_runtime.stack.runs import Run

    run = Run(folder)
    outcome = run.state().get("outcome")
    if not isinstance(outcome, dict) or not outcome:
        return None
    result = read_json_object(folder / "result.json")
    result.pop("outcome", None)
    return {**result, **outcome, "options": conform(run.info().get("options"), {})}


def _score(folder: Path) -> Callable[[Path], dict[str, Any]] | None:
    """Return the function that compares the run with the simulator's ground truth; None if the run has none."""
    if not (folder / "truth.json").exists():
        return None
    from lupin_cli.run.summary import score_run

    return score_run


def show_page(page: Path) -> None:
    """Open a page in the browser, if this terminal has a display."""
    if has_display():
        typer.launch(str(page))


def has_display() -> bool:
    """Return whether a browser can open for the user of this terminal."""
    if not sys.stdout.isatty():
        return False
    return sys.platform == "darwin" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
