"""`lupin runs`: the runs on the disk, and how many of them are kept."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import typer

from lupin_cli.exit_codes import FAILURE, UNREACHABLE
from lupin_cli.terminal import echo

if TYPE_CHECKING:
    from lupin_runtime.stack.retention import StoredRun

GB = 10**9
app = typer.Typer(
    help="The runs on this computer's disk: list, keep and remove them.",
    add_completion=False,
    rich_markup_mode=None,
    no_args_is_help=True,
)
AS_JSON = typer.Option(False, "--json", help="Print only JSON on standard output.")


@app.command("list")
def list_(as_json: bool = AS_JSON) -> None:
    """List the runs with their result and size, oldest first. Changes nothing.

    Exit status: 0 listed.
    """
    from lupin_runtime.stack.retention import stored_runs

    stored = stored_runs()
    if as_json:
        print(json.dumps([_plain(one) for one in stored]))
        return
    for one in stored:
        row = _plain(one)
        echo(f"{row['id']}  {row['size_bytes'] / 1e6:8.1f} MB  {row['state']:12s}{'  kept' if row['kept'] else ''}".rstrip())
    total_gb = sum(one.size_bytes for one in stored) / GB
    echo(f"{len(stored)} runs, {total_gb:.2f} GB; remove old ones with: lupin runs prune" if stored else "there is no run")


@app.command()
def keep(
    run: str = typer.Argument(..., help="A part of the run's id."),
    off: bool = typer.Option(False, "--off", help="Allow its removal again."),
) -> None:
    """Protect a run from removal.

    Exit status: 0 done, 3 no such run.
    """
    from lupin_runtime.stack.runs import RunError, find_run

    try:
        found = find_run(run)
    except RunError as error:
        echo(str(error), err=True)
        raise typer.Exit(UNREACHABLE) from error
    found.keep(not off)
    echo(f"run {found.id} {'may be removed again' if off else 'is kept'}")


@app.command()
def prune(
    count: int = typer.Option(None, "--count", min=0, help="Keep at most this many runs; the default is 50."),
    gigabytes: float = typer.Option(None, "--max-gb", min=0.0, help="Keep at most this many GB of runs; the default is 20."),
    dry_run: bool = typer.Option(False, "--dry-run", help="Only print which runs would be removed."),
    as_json: bool = AS_JSON,
) -> None:
    """Remove the oldest ended runs that exceed a number and a size. The newest five stay, unless --count is smaller.

    `lupin up` does the same with the defaults.

    Exit status: 0 removed or nothing to do, 1 a run could not be removed.
    """
    from lupin_runtime.stack.retention import MAX_BYTES, MAX_RUNS, removable, remove, stored_runs

    max_bytes = MAX_BYTES if gigabytes is None else int(gigabytes * GB)
    chosen = removable(stored_runs(), MAX_RUNS if count is None else count, max_bytes)
    not_removed = [] if dry_run else [one for one in chosen if not remove(one)]
    if as_json:
        print(json.dumps({"removed": [_plain(one) for one in chosen if one not in not_removed], "dry_run": dry_run}))
    else:
        for one in chosen:
            if one not in not_removed:
                echo(f"{'would remove' if dry_run else 'removed'} {one.run.id} ({one.size_bytes / 1e6:.1f} MB)")
        if not chosen:
            echo("nothing to remove")
    for one in not_removed:
        echo(f"{one.run.path} could not be removed; check its permissions", err=True)
    if not_removed:
        raise typer.Exit(FAILURE)


def _plain(stored: StoredRun) -> dict[str, Any]:
    outcome = stored.run.state().get("outcome")
    ended = outcome.get("state", "ended") if isinstance(outcome, dict) else "ended"
    return {
        "id": stored.run.id,
        "path": str(stored.run.path),
        "size_bytes": stored.size_bytes,
        "state": "up" if stored.is_alive else str(ended),
        "kept": stored.is_kept,
    }
