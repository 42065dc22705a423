"""`lupin runs`: the runs on the disk, and how many of them are kept."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import typer

from lupin_cli.command_group import command_group
from lupin_cli.completion import runs as complete_runs
from lupin_cli.exit_codes import FAILURE, UNREACHABLE
from lupin_cli.terminal import echo

if TYPE_CHECKING:
    from lupin_runtime.stack.retention import StoredRun

GB = 10**9
AS_JSON = typer.Option(False, "--json", help="Print only JSON on standard output.")
app = command_group(
    "List the past runs with result, world and duration; keep and remove runs.",
    "lupin runs --json",
    invoke_without_command=True,
)


@app.callback()
def runs(context: typer.Context, as_json: bool = AS_JSON) -> None:
    """List the past runs with result, world and duration; keep and remove runs."""
    if context.invoked_subcommand is None:
        _list(as_json)


@app.command("list")
def list_(as_json: bool = AS_JSON) -> None:
    """List the runs with result, world, tags read and duration, newest first. Changes nothing.

    Exit status: 0 listed.

    Example: lupin runs list --json
    """
    _list(as_json)


def _list(as_json: bool) -> None:
    from lupin_runtime.stack.results import result_of
    from lupin_runtime.stack.retention import stored_runs

    stored = stored_runs()[::-1]
    if as_json:
        print(json.dumps([_plain(one) for one in stored]))
        return
    if not stored:
        echo("there is no run; start one with: lupin up")
        return
    from lupin_cli.run.results import results_table, short_ids, summary_of
    from lupin_cli.safe_console import SafeConsole

    results = [result_of(one.run) for one in stored]
    console = SafeConsole()
    console.print(f"{summary_of(results)}\n", soft_wrap=True)
    for line in results_table(results, {one.run.id for one in stored if one.is_kept}):
        # A terminal shows as much of a reason as fits into the line, a pipe gets it in full.
        if console.is_terminal:
            console.print(line, no_wrap=True, overflow="ellipsis")
        else:
            console.print(line, soft_wrap=True)
    name = next(iter(short_ids([result.id for result in results]).values()))
    size_gb = sum(one.size_bytes for one in stored) / GB
    echo(f"\nits logs     lupin logs --run {name}   (any unique part of the id)")
    echo("its report   lupin report latest     (or the newest run)")
    echo(f"on the disk  {size_gb:.2f} GB; remove old runs with: lupin runs prune")


@app.command()
def keep(
    run: str = typer.Argument(..., help="Any unique part of the run's id, or: latest.", autocompletion=complete_runs),
    off: bool = typer.Option(False, "--off", help="Allow its removal again."),
) -> None:
    """Protect a run from removal.

    Exit status: 0 done, 3 no such run.

    Example: lupin runs keep latest
    """
    from lupin_runtime.stack.runs import RunError, find_run

    try:
        found = find_run(run)
    except RunError as error:
        echo(str(error), err=True)
        raise typer.Exit(UNREACHABLE) from error
    found.set_kept(not off)
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

    Example: lupin runs prune --count 20 --dry-run
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
    from lupin_runtime.stack.results import result_of

    return {
        **result_of(stored.run).as_json(),
        "path": str(stored.run.path),
        "size_bytes": stored.size_bytes,
        "kept": stored.is_kept,
    }
