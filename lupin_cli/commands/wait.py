"""`lupin wait`: wait until a robot is reachable, free or healthy, at most for a given time."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from enum import Enum
from typing import TYPE_CHECKING, Annotated

import typer

from lupin_cli.connection.base import Unreachable
from lupin_cli.connection.inventory import ConfigError
from lupin_cli.connection.options import CONFIG, LOCAL, ROBOT, open_target, reporting_errors, select_subject
from lupin_cli.exit_codes import FAILURE, SUCCESS
from lupin_cli.printed_commands import lupin, print_next
from lupin_cli.terminal import can_repaint, echo, erase_status_line, show_status_line

if TYPE_CHECKING:
    from lupin_cli.connection.inventory import Config, Robot

POLL_S = 2.0


class Condition(str, Enum):
    """What `lupin wait` waits for."""

    HEALTHY = "healthy"
    FREE = "free"
    REACHABLE = "reachable"


def command(
    condition: Annotated[
        Condition,
        typer.Argument(help="healthy: the doctor finds nothing; free: no playbook run holds the robot's lease; reachable."),
    ] = Condition.HEALTHY,
    robot: ROBOT = None,
    local: LOCAL = False,
    timeout_s: Annotated[float, typer.Option("--timeout", min=0.0, help="Give up after this many seconds.")] = 300.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print only JSON on standard output.")] = False,
    config: CONFIG = None,
) -> None:
    """Wait until the robot is healthy, free or reachable; show what it is waiting for.

    Exit status: 0 the condition holds, 1 it did not hold within --timeout (the reason is printed), 2 usage, 130 interrupted.

    Example: lupin wait healthy --timeout 60
    """
    with reporting_errors("wait"):
        inventory, robots = select_subject(config, robot, local=local)
        if local and condition is not Condition.HEALTHY:
            raise ConfigError(f"this machine is always {condition.value}; --local goes with healthy")
        if len(robots) > 1:
            raise ConfigError("lupin wait waits for one robot; name one with --robot")
        chosen = robots[0] if robots else None
        name = chosen.name if chosen else "this machine"
        start = time.monotonic()
        reason = _poll(lambda: _obstacle(condition, chosen, inventory), name, timeout_s, quiet=as_json)
    waited_s = round(time.monotonic() - start, 1)
    if as_json:
        print(json.dumps({"subject": name, "condition": condition.value, "waited_s": waited_s, "reason": reason}))
    elif not reason:
        echo(f"{name} is {condition.value}, after {waited_s:g} s")
    if reason:
        echo(f"lupin wait: {name} is not {condition.value} after {waited_s:g} s: {reason}", err=True)
        print_next(lupin("doctor", *([] if chosen else ["--local"]), robot=chosen.name if chosen else ""))
    raise typer.Exit(FAILURE if reason else SUCCESS)


def _poll(obstacle: Callable[[], str], name: str, timeout_s: float, *, quiet: bool) -> str:
    """Ask for the obstacle until there is none or the time is up; print each new one. Return the last one."""
    deadline = time.monotonic() + timeout_s
    shown = ""
    live = can_repaint(sys.stderr) and not quiet
    while True:
        found = obstacle()
        if live:
            erase_status_line()
        if not found or time.monotonic() >= deadline:
            return found
        if found != shown and not quiet:
            echo(f"waiting: {name}: {found}", err=True)
            shown = found
        pause_s = min(POLL_S, max(0.0, deadline - time.monotonic()))
        if live:
            show_status_line(f"{deadline - time.monotonic():.0f} s left")
        time.sleep(pause_s)


def _obstacle(condition: Condition, robot: Robot | None, inventory: Config | None) -> str:
    """Return why the condition does not hold now; empty if it does."""
    if condition is Condition.HEALTHY:
        return _sickness(robot, inventory)
    from lupin_cli.playbook.lease import read_holder

    assert robot is not None
    try:
        target = open_target(robot, inventory)
        try:
            holder = read_holder(target)
        finally:
            target.close()
    except Unreachable as error:
        return str(error)
    if condition is Condition.FREE and holder is not None and not holder.is_stale:  # the next run takes a stale lease over
        return f"it is being changed by {holder.who} ({holder.purpose})"
    return ""


def _sickness(robot: Robot | None, inventory: Config | None) -> str:
    from lupin_cli.checks.table import built_in
    from lupin_cli.connection.local import LocalTarget
    from lupin_cli.doctor.report import exit_status
    from lupin_cli.doctor.session import DoctorScope, DoctorSession

    session = DoctorSession(DoctorScope(built_in(), (), LocalTarget(), robot, inventory))
    try:
        result = session.examine()
    finally:
        session.close()
    if exit_status(result.diagnosis, result.link) == SUCCESS:
        return ""
    causes = [root.finding.id for root in result.diagnosis.roots]
    return ", ".join(causes) or "not everything could be examined"
