"""`lupin sweep`: remove what dead ROS processes left behind."""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING, Any

import typer

from lupin_cli.config import load
from lupin_cli.robot_options import ASK_SUDO, CONFIG, ROBOT, ask_sudo_password, connect, reporting, select

if TYPE_CHECKING:
    from lupin_cli.sweep import Kept, Plan, Result
    from lupin_cli.target import Target

CLEAN, LEFT = 0, 1


def command(
    robot: ROBOT = None,
    dry_run: bool = typer.Option(False, "--dry-run", help="Only say what would be ended and removed."),
    as_json: bool = typer.Option(False, "--json", help="Print JSON, alone on standard output."),
    config: CONFIG = None,
    ask_sudo: ASK_SUDO = False,
) -> None:
    """End zombie ROS processes on DDS ports, by number and after a look at each; remove shared memory that nobody holds.

    Sweeps this machine, or a robot with --robot. What a live run, a service or an operator's terminal owns is named and left
    alone. Exit status: 0 nothing is left over, 1 something is (with --dry-run: would be removed), 2 usage, 3 the robot can't
    be reached.
    """
    from lupin_cli.target.local import LocalTarget

    with reporting("sweep"):
        if robot is None:
            who = {"user_id": os.geteuid(), "runs": live_run_processes(), "ourselves": frozenset({os.getpid()})}
            raise typer.Exit(_sweep(LocalTarget(), who, dry_run, as_json))
        inventory, status = load(config), CLEAN
        for one in select(inventory, robot):
            with connect(one, inventory, sudo_password=ask_sudo_password(one.name) if ask_sudo else None) as target:
                status = max(status, _sweep(target, {"user_id": 0}, dry_run, as_json))
    raise typer.Exit(status)


def _sweep(target: Target, who: dict[str, Any], dry_run: bool, as_json: bool) -> int:
    from lupin_cli.sweep import look, sweep

    if dry_run:
        plan = look(target, **who)
        _tell_plan(plan, as_json)
        return CLEAN if plan.clean else LEFT
    result = sweep(target, **who)
    _tell_result(result, as_json)
    return LEFT if result.failed or any(kept.blocks for kept in result.kept) else CLEAN


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
