"""The option by which commands name a run: `latest`, or any part of its id that no other run has."""

from __future__ import annotations

from typing import Annotated

import typer

from lupin_cli.completion import live_runs, runs

LIVE_RUN = Annotated[
    str | None,
    typer.Option("--run", help="Select a run that is up, by any unique part of its id, or: latest.", autocompletion=live_runs),
]
ANY_RUN = Annotated[
    str | None,
    typer.Option(
        "--run", help="Select a run by any unique part of its id, or: latest [the live or newest one].", autocompletion=runs
    ),
]
