"""`lupin sweep`: remove what dead ROS processes left behind."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import typer

from lupin_cli.connection.options import (
    ASK_SUDO,
    CONFIG,
    LOCAL,
    ROBOT,
    ask_sudo_passwords,
    connect,
    one_after_another,
    reporting_errors,
    select_subject,
)
from lupin_cli.exit_codes import FAILURE, SUCCESS
from lupin_cli.terminal import echo

if TYPE_CHECKING:
    from lupin_cli.cleanup import CleanupPlan, CleanupResult, Kept, StaleProcess, StaleSegment
    from lupin_cli.connection import Target
    from lupin_cli.connection.inventory import Robot


def command(
    robot: ROBOT = None,
    local: LOCAL = False,
    dry_run: bool = typer.Option(False, "--dry-run", help="Only list what would be terminated and removed."),
    as_json: bool = typer.Option(False, "--json", help="Print only JSON on standard output."),
    config: CONFIG = None,
    ask_sudo: ASK_SUDO = False,
) -> None:
    """Terminate stale ROS processes that hold DDS ports, and remove shared memory that no process uses.

    Cleans up the default robot, or with --local this machine. Processes of a live run, of a service or of a terminal that is
    still open are listed and left alone; each process is checked again before it is terminated. Exit status: 0 nothing stale is
    left, 1 something is (also with --dry-run), 2 usage, 3 the robot cannot be reached.

    Example: lupin sweep --local --dry-run
    """
    from lupin_cli.cleanup.live_runs import live_run_processes
    from lupin_cli.connection.local import LocalTarget

    with reporting_errors("sweep"):
        inventory, robots = select_subject(config, robot, local=local)
        if inventory is None:
            options = {"user_id": os.geteuid(), "runs": live_run_processes(), "own_pids": frozenset({os.getpid()})}
            report, status = _clean_up(LocalTarget(), options, dry_run, as_json)
            if as_json:
                print(json.dumps(report))
            raise typer.Exit(status)
        passwords = ask_sudo_passwords(robots) if ask_sudo else {}

        def clean_up_robot(one: Robot) -> tuple[dict[str, Any], int]:
            with connect(one, inventory, sudo_password=passwords.get(one.name)) as target:
                report, status = _clean_up(target, {"user_id": 0}, dry_run, as_json)
            return {"robot": one.name, **report}, status

        reports, status = one_after_another("sweep", robots, clean_up_robot)
        if as_json:
            print(json.dumps(reports if len(reports) != 1 else reports[0]))
    raise typer.Exit(status)


def _clean_up(target: Target, options: dict[str, Any], dry_run: bool, quiet: bool) -> tuple[dict[str, Any], int]:
    """Return the report for `--json`, and the exit status; unless `quiet`, print what was found and done."""
    from lupin_cli.cleanup import clean_up, find_stale

    if dry_run:
        plan = find_stale(target, **options)
        if not quiet:
            _print_plan(plan)
        processes, segments = _processes_json(plan.processes), _segments_json(plan.segments)
        found = {"culprits": processes, "orphans": segments, "kept": _kept_json(plan.kept)}
        return found, SUCCESS if plan.is_empty else FAILURE
    result = clean_up(target, **options)
    if not quiet:
        _print_result(result)
    ended, removed = _processes_json(result.terminated), _segments_json(result.removed)
    done = {"ended": ended, "removed": removed, "kept": _kept_json(result.kept), "failed": result.failures}
    return done, FAILURE if result.failures or any(kept.needs_root for kept in result.kept) else SUCCESS


def _print_plan(plan: CleanupPlan) -> None:
    for process in plan.processes:
        echo(f"would terminate {process.name} ({process.pid}){_ports(process.ports)}: {process.reason}")
    for segment in plan.segments:
        echo(f"would remove {', '.join(segment.files)}")
    _print_kept(plan.kept)
    if plan.is_empty:
        echo("nothing is left over")


def _print_result(result: CleanupResult) -> None:
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
