"""`lupin mission`: control the mission of a run, and draw the mission's state machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lupin_cli.command_group import command_group
from lupin_cli.exit_codes import FAILURE, USAGE_ERROR
from lupin_cli.run.mission_client import register
from lupin_cli.terminal import echo

app = command_group(
    "Start, pause, resume or abort a mission; draw its state machine.", "lupin mission status", no_args_is_help=True
)


@app.command()
def diagram(
    form: Annotated[str, typer.Option("--format", "-f", help="Draw as mermaid, dot, svg or ascii.")] = "mermaid",
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Write to this file instead of standard output.")] = None,
) -> None:
    """Draw the mission's state machine. Needs neither a run nor ROS.

    Example: lupin mission diagram --out mission.svg
    """
    from lupin_runtime.mission.diagram import FORMATS, draw
    from lupin_runtime.mission.hsm_spec import build_hsm_spec

    if form not in FORMATS:
        echo(f"unknown format {form!r}, expected one of: {', '.join(FORMATS)}", err=True)
        raise typer.Exit(USAGE_ERROR)
    text = draw(build_hsm_spec(), form)
    if out is None:
        echo(text, nl=False)
        return
    try:
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        echo(f"cannot write {out}: {error.strerror}", err=True)
        raise typer.Exit(FAILURE) from error
    echo(f"wrote {out}")


register(app)
