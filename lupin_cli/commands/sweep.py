"""`lupin sweep`: remove what dead ROS processes left behind."""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from lupin_cli.sweep import Kept, Plan, Result

CLEAN, LEFT, UNREACHABLE = 0, 1, 3


def command(
    robot: str = typer.Option(None, "--robot", help="Sweep this robot instead of this machine."),
    dry_run: bool = typer.Option(False, "--dry-run", help="Only say what would be ended and removed."),
    as_json: bool = typer.Option(False, "--json", help="Print JSON, alone on standard output."),
) -> None:
    """End zombie ROS processes on DDS ports, by number and after a look at each; remove shared memory that nobody holds.

    What a live run, a service or an operator's terminal owns is named and left alone.
    Exit status: 0 nothing is left over, 1 something is (with --dry-run: would be removed), 3 the robot can't be reached.
    """
    from lupin_cli.sweep import look, sweep
    from lupin_cli.target import TargetError

    try:
        target, who = _target(robot)
        try:
            if dry_run:
                plan = look(target, **who)
                _tell_plan(plan, as_json)
                raise typer.Exit(CLEAN if plan.clean else LEFT)
            result = sweep(target, **who)
        finally:
            target.close()
    except TargetError as error:
        typer.echo(f"lupin sweep: {error}" + (f"; next: {error.next_command}" if error.next_command else ""), err=True)
        raise typer.Exit(UNREACHABLE) from error
    _tell_result(result, as_json)
    raise typer.Exit(LEFT if result.failed or any(kept.blocks for kept in result.kept) else CLEAN)


def _target(robot: str | None):  # type: ignore[no-untyped-def]
    """Where to sweep, and as whom: root on a robot, ourselves here."""
    if robot is not None:
        from lupin_cli.target.open import open_robot

        return open_robot(robot), {"user_id": 0}
    from lupin_cli.target.local import LocalTarget

    return LocalTarget(), {"user_id": os.geteuid(), "runs": live_run_processes(), "ourselves": frozenset({os.getpid()})}


def live_run_processes() -> dict[int, str]:
    """The processes of this user's live runs, with the run's name; their children are found by whose children they are."""
    from lupin_runtime.stack.runs import live_runs

    found = {}
    for run in live_runs():
        pids = [run.info().get("pid"), *(stage.get("pid") for stage in run.state().get("stages", []))]
        found.update({pid: run.id for pid in pids if isinstance(pid, int)})
    return found


def _tell_plan(plan: Plan, as_json: bool) -> None:
    from dataclasses import asdict

    if as_json:
        print(json.dumps(asdict(plan)))
        return
    for culprit in plan.culprits:
        typer.echo(f"would end {culprit.name} ({culprit.pid}){_ports(culprit.ports)}: {culprit.why}")
    for orphan in plan.orphans:
        typer.echo(f"would remove {', '.join(orphan.files)}")
    _tell_kept(plan.kept)
    if plan.clean:
        typer.echo("nothing is left over")


def _tell_result(result: Result, as_json: bool) -> None:
    from dataclasses import asdict

    if as_json:
        print(json.dumps(asdict(result)))
        return
    for culprit in result.ended:
        typer.echo(f"ended {culprit.name} ({culprit.pid}){_ports(culprit.ports)}: {culprit.why}")
    if result.removed:
        files = [name for orphan in result.removed for name in orphan.files]
        size_kb = sum(orphan.size_bytes for orphan in result.removed) / 1000
        typer.echo(f"removed {len(files)} files of shared memory, {size_kb:.0f} kB: {', '.join(files)}")
    _tell_kept(result.kept)
    for line in result.failed:
        typer.echo(f"failed: {line}", err=True)
    if not (result.ended or result.removed or result.failed):
        typer.echo("nothing is left over")


def _tell_kept(kept: tuple[Kept, ...]) -> None:
    for each in kept:
        typer.echo(f"left {each.what}: {each.why}", err=each.blocks)


def _ports(ports: tuple[int, ...]) -> str:
    return f" on {', '.join(map(str, ports))}" if ports else ""
