"""`lupin foxglove`: what Foxglove and Lichtblick need besides the server of `lupin up --foxglove`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lupin_cli.command_group import command_group
from lupin_cli.exit_codes import FAILURE
from lupin_cli.terminal import echo

app = command_group("Write the layout for Foxglove and Lichtblick.", "lupin foxglove layout", no_args_is_help=True)


@app.callback()
def root() -> None:
    """Keep `layout` a subcommand: Typer would make the only command the group itself."""


@app.command()
def layout(
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Write to this file instead of standard output.")] = None,
) -> None:
    """Write the layout to import into Foxglove or Lichtblick. Needs neither a run nor the extra `foxglove`.

    Exit status: 0 written, 1 the file cannot be written.

    Example: lupin foxglove layout --out lupin.json
    """
    from lupin_runtime.foxglove.layout import LAYOUT

    text = LAYOUT.read_text(encoding="utf-8")
    if out is None:
        echo(text, nl=False)
        return
    try:
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        echo(f"cannot write {out}: {error.strerror}", err=True)
        raise typer.Exit(FAILURE) from error
    echo(f"wrote {out}; import it in Foxglove or Lichtblick with: Layouts, Import from file")
