"""`lupin report`: rebuild the report of a recorded run, or compare two."""

from __future__ import annotations

import json
from pathlib import Path

import typer

from lupin_cli import user_path
from lupin_cli.completion import runs as run_names
from lupin_cli.exit_codes import USAGE_ERROR
from lupin_cli.run.recordings import RUN_HELP, build_run_comparison, build_run_report, show_page
from lupin_cli.terminal import echo
from lupin_runtime.stack.runs import LATEST


def command(
    runs: list[str] = typer.Argument(None, help=f"{RUN_HELP} Two of them are compared.", autocompletion=run_names),
    out: Path = typer.Option(None, "--out", parser=user_path.path, help="Write the report, or the comparison, to this folder."),
    as_json: bool = typer.Option(False, "--json", help="Print only the JSON of the report or comparison on standard output."),
    open_page: bool = typer.Option(False, "--open", help="Open the page in a browser."),
) -> None:
    """Build the report of a recorded run: report.html and report.json, and trajectory.tum beside the recording.

    A simulated run is scored again against ground truth. With two runs, a comparison of both is written beside the report of
    the second. Exit status: 0 built, 1 no readable recording, 2 usage.

    Example: lupin report latest --open
    """
    if len(runs or ()) > 2:
        echo(f"lupin report compares two runs, and {len(runs)} were named", err=True)
        raise typer.Exit(USAGE_ERROR)
    page = _compare(runs[0], runs[1], out, as_json) if len(runs or ()) == 2 else _report((runs or [LATEST])[0], out, as_json)
    if open_page:
        show_page(page)


def _report(name: str, out: Path | None, as_json: bool) -> Path:
    report = build_run_report(name, out)
    if as_json:
        print(json.dumps(report.content))
        return report.page
    figures = report.content["figures"]
    echo(
        f"{report.content['run']['state']}: {figures['tags_read']} of {figures['tags_seen']} tags read, "
        f"{figures['distance_m']:.1f} m driven, {figures['mission_s']:.0f} s of mission"
    )
    for finding in report.content["findings"]:
        if finding["severity"] in ("error", "warn"):
            echo(f"  {finding['severity']}: {finding['title']}. {finding['detail']}".rstrip())
            if finding["action"]:
                echo(f"    {finding['action']}{': ' if finding['command'] else '.'}{finding['command']}")
    echo(str(report.page))
    return report.page


def _compare(name_a: str, name_b: str, out: Path | None, as_json: bool) -> Path:
    from lupin_runtime.report import comparison_lines

    comparison = build_run_comparison(name_a, name_b, out)
    if as_json:
        print(json.dumps(comparison.content))
        return comparison.page
    for line in comparison_lines(comparison.source):
        echo(line)
    echo(str(comparison.page))
    return comparison.page
