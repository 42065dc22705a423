"""The mission of a run: start, hold and end it, and draw its state machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lupin_cli.mission_calls import register

app = typer.Typer(
    help="Start, pause, resume or abort a mission; draw its state machine.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

USAGE_ERROR, FAILED = 2, 1


@app.command()
def diagram(
    form: Annotated[str, typer.Option("--format", "-f", help="mermaid, dot, svg or ascii.")] = "mermaid",
    out: Annotated[Path | None, typer.Option("--out", "-o", help="File to write; else standard output.")] = None,
) -> None:
    """Draw the mission's state machine from its definition. Needs no run and no ROS."""
    from lupin_runtime.mission.diagram import FORMATS
    from lupin_runtime.mission.hsm import build_hsm_spec

    if form not in FORMATS:
        typer.echo(f"there is no format {form!r}; there are: {', '.join(FORMATS)}", err=True)
        raise typer.Exit(USAGE_ERROR)
    text = FORMATS[form](build_hsm_spec())
    if out is None:
        typer.echo(text, nl=False)
        return
    try:
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        typer.echo(f"cannot write {out}: {error.strerror}", err=True)
        raise typer.Exit(FAILED) from error
    typer.echo(f"wrote {out}")


register(app)
