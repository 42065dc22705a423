"""`lupin sweep`: remove what dead ROS processes left behind."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import typer

from lupin_cli.connection.inventory import load
from lupin_cli.connection.options import ASK_SUDO, CONFIG, ROBOT, ask_sudo_password, connect, reporting_errors, select_robots
from lupin_cli.exit_codes import FAILURE, SUCCESS
from lupin_cli.terminal import echo

if TYPE_CHECKING:
    from lupin_cli.cleanup import CleanupPlan, CleanupResult, Kept, StaleProcess, StaleSegment
    from lupin_cli.connection import Target


def command(
    robot: ROBOT = None,
    dry_run: bool = typer.Option(False, "--dry-run", help="Only list what would be terminated and removed."),
    as_json: bool = typer.Option(False, "--json", help="Print only JSON on standard output."),
    config: CONFIG = None,
    ask_sudo: ASK_SUDO = False,
) -> None:
    """Terminate stale ROS processes that hold DDS ports, and remove shared memory that no process uses.

    Cleans up this machine, or a robot with --robot. Processes of a live run, of a service or of a terminal that is still open
    are listed and left alone; each process is checked again before it is terminated. Exit status: 0 nothing stale is
    left, 1 something is (also with --dry-run), 2 usage, 3 the robot cannot be reached.
    """
    from lupin_cli.cleanup.live_runs import live_run_processes
    from lupin_cli.connection.local import LocalTarget

    with reporting_errors("sweep"):
        if robot is None:
            options = {"user_id": os.geteuid(), "runs": live_run_processes(), "own_pids": frozenset({os.getpid()})}
            raise typer.Exit(_clean_up(LocalTarget(), options, dry_run, as_json))
        inventory, status = load(config), SUCCESS
        for one in select_robots(inventory, robot):
            with connect(one, inventory, sudo_password=ask_sudo_password(one.name) if ask_sudo else None) as target:
                status = max(status, _clean_up(target, {"user_id": 0}, dry_run, as_json))
    raise typer.Exit(status)


def _clean_up(target: Target, options: dict[str, Any], dry_run: bool, as_json: bool) -> int:
    from lupin_cli.cleanup import clean_up, find_stale

    if dry_run:
        plan = find_stale(target, **options)
        _print_plan(plan, as_json)
        return SUCCESS if plan.is_empty else FAILURE
    result = clean_up(target, **options)
    _print_result(result, as_json)
    return FAILURE if result.failures or any(kept.needs_root for kept in result.kept) else SUCCESS


def _print_plan(plan: CleanupPlan, as_json: bool) -> None:
    if as_json:
        processes, segments = _processes_json(plan.processes), _segments_json(plan.segments)
        print(json.dumps({"culprits": processes, "orphans": segments, "kept": _kept_json(plan.kept)}))
        return
    for process in plan.processes:
        echo(f"would terminate {process.name} ({process.pid}){_ports(process.ports)}: {process.reason}")
    for segment in plan.segments:
        echo(f"would remove {', '.join(segment.files)}")
    _print_kept(plan.kept)
    if plan.is_empty:
        echo("nothing is left over")


def _print_result(result: CleanupResult, as_json: bool) -> None:
    if as_json:
        ended, removed = _processes_json(result.terminated), _segments_json(result.removed)
        print(json.dumps({"ended": ended, "removed": removed, "kept": _kept_json(result.kept), "failed": result.failures}))
        return
    for process in result.terminated:
        echo(f"terminated {process.name} ({process.pid}){_ports(process.ports)}: {process.reason}")
    if result.removed:
        files = [name for segment in result.removed for name in segment.files]
        size_kb = sum(segment.size_bytes for segment in result.removed) / 1000
        echo(f"removed {len(files)} files of shared memory, {size_kb:.0f} kB: {', '.join(files)}")
    _print_kept(result.kept)
    for line in result.failures:
        echo(f"failed: {line}", err=True)
    if not (result.terminated or result.removed or result.failures):
        echo("nothing is left over")


def _print_kept(kept: tuple[Kept, ...]) -> None:
    for each in kept:
        echo(f"left {each.subject}: {each.reason}", err=each.needs_root)


# The keys of the JSON output are stable; the classes' field names need not be.


def _processes_json(processes: Iterable[StaleProcess]) -> list[dict[str, Any]]:
    rows = [asdict(process) for process in processes]
    return [{("why" if key == "reason" else key): value for key, value in row.items()} for row in rows]


def _segments_json(segments: Iterable[StaleSegment]) -> list[dict[str, Any]]:
    return [asdict(segment) for segment in segments]


def _kept_json(kept: Iterable[Kept]) -> list[dict[str, Any]]:
    return [{"what": each.subject, "why": each.reason, "blocks": each.needs_root} for each in kept]


def _ports(ports: tuple[int, ...]) -> str:
    return f" on {', '.join(map(str, ports))}" if ports else ""
