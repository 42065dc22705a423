"""`lupin report`: rebuild the report of a recorded run."""

from __future__ import annotations

import json
from pathlib import Path

import typer

from lupin_cli.run.recordings import RUN_HELP, build_run_report, show_page
from lupin_cli.terminal import echo


def command(
    run: str = typer.Argument("latest", help=RUN_HELP),
    out: Path = typer.Option(None, "--out", help="Write the report to this folder."),
    as_json: bool = typer.Option(False, "--json", help="Print only the report's JSON on standard output."),
    open_page: bool = typer.Option(False, "--open", help="Open the page in a browser."),
) -> None:
    """Build the report of a recorded run: report.html and report.json, and trajectory.tum beside the recording.

    A simulated run is scored again against ground truth. Exit status: 0 built, 1 no readable recording, 2 usage.
    """
    report = build_run_report(run, out)
    if as_json:
        print(json.dumps(report.content))
    else:
        figures = report.content["figures"]
        echo(
            f"{report.content['run']['state']}: {figures['tags_read']} of {figures['tags_seen']} tags read, "
            f"{figures['distance_m']:.1f} m driven, {figures['mission_s']:.0f} s of mission"
        )
        for finding in report.content["findings"]:
            if finding["severity"] in ("error", "warn"):
                echo(f"  {finding['severity']}: {finding['title']}. {finding['detail']}".rstrip())
        echo(str(report.page))
    if open_page:
        show_page(report.page)
