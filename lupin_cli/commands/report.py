"""`lupin report`: the report of a recorded run, built again."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from lupin_runtime.report import Report


def command(
    run: str = typer.Argument("latest", help="A recording, a run directory, a run's id or its beginning, or: latest."),
    out: Path = typer.Option(None, "--out", help="Another folder for the report."),
    as_json: bool = typer.Option(False, "--json", help="Print the report's JSON, alone on standard output."),
    open_page: bool = typer.Option(False, "--open", help="Open the page in a browser."),
) -> None:
    """Build the report of a recorded run: report.html, report.json, and trajectory.tum beside the recording.

    In a simulated run it is scored against the truth again. Exit status: 0 built, 1 nothing readable is recorded, 2 usage.
    """
    report = build(run, out)
    if as_json:
        print(json.dumps(report.content))
    else:
        n = report.content["figures"]
        typer.echo(
            f"{report.content['run']['state']}: {n['tags_read']} of {n['tags_seen']} tags read, "
            f"{n['distance_m']:.1f} m driven, {n['mission_s']:.0f} s of mission"
        )
        for finding in report.content["findings"]:
            if finding["severity"] in ("error", "warn"):
                typer.echo(f"  {finding['severity']}: {finding['title']}. {finding['detail']}".rstrip())
        typer.echo(str(report.page))
    if open_page:
        show(report.page)


def build(name: str, out: Path | None) -> Report:
    """Build the report of the run that `name` means; ends the command with a sentence where that can't be done."""
    from lupin_cli.commands.replay import open_run
    from lupin_runtime.record.reader import NotARecording
    from lupin_runtime.report import build_report

    found, _ = open_run(name)
    try:
        return build_report(found, facts=_facts(found.folder), score=_score(found.folder), out=out)
    except NotARecording as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(1) from error
    except OSError as error:
        typer.echo(f"the report can't be written: {error}; try another folder with --out", err=True)
        raise typer.Exit(1) from error


def _facts(folder: Path) -> dict[str, Any] | None:
    """What the supervisor left of an ended run; None where it left nothing, so that an earlier report's facts stay."""
    from lupin_runtime.stack.runs import Run

    run = Run(folder)
    outcome = run.state().get("outcome")
    if not outcome:
        return None
    try:
        result = json.loads((folder / "result.json").read_text())
    except (OSError, ValueError):
        result = {}
    result.pop("outcome", None)
    return {**result, **outcome, "options": run.info().get("options", {})}


def _score(folder: Path) -> Any:
    """The comparison with the simulator's truth, where it left one."""
    if not (folder / "truth.json").exists():
        return None
    from lupin_cli.results import score_run

    return score_run


def show(page: Path) -> None:
    """Open a page in the person's browser, where there is a screen."""
    from lupin_cli.commands.replay import has_display

    if has_display():
        typer.launch(str(page))
