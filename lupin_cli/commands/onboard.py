"""`lupin onboard`: what a robot does by itself."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import typer

from lupin_cli.command_group import command_group
from lupin_cli.connection.options import CONFIG, ROBOT
from lupin_cli.exit_codes import FAILURE, NO_RESULT, SUCCESS
from lupin_cli.printed_commands import complete, print_next
from lupin_cli.terminal import echo

if TYPE_CHECKING:
    from lupin_cli.connection.inventory import Robot
    from lupin_cli.onboard_status import Status

app = command_group(
    "Show what a robot does by itself, without a laptop.",
    "lupin onboard status",
    no_args_is_help=True,
)


@app.callback()
def onboard() -> None:
    """Keep `status` a word of its own."""


@app.command()
def status(
    robot: ROBOT = None,
    config: CONFIG = None,
    as_json: bool = typer.Option(False, "--json", help="Print only JSON on standard output."),
) -> None:
    """Show what the robot is doing, its units, the processes on it, and its arm, cameras and gamepad. Changes nothing.

    It is what the light strip shows: waiting for vendor, homing, ready, or needs help. The robot is asked in one round trip;
    this machine joins no graph. For a run on this machine: lupin status.

    Exit status: 0 ready, 1 not ready yet or something is wrong (each with the next command), 2 usage, 3 the robot cannot be
    reached, 4 it answered, and its units or processes could not be read.

    Example: lupin onboard status --robot greenhouse
    """
    from lupin_cli.connection.inventory import load
    from lupin_cli.connection.options import one_after_another, open_target, reporting_errors, select_robots
    from lupin_cli.doctor.gathering import gather_facts
    from lupin_cli.facts.camera_drivers import CAMERA_DRIVERS
    from lupin_cli.facts.onboard import ONBOARD_STATE
    from lupin_cli.facts.units import UNIT_STATES
    from lupin_cli.onboard_status import judge

    with reporting_errors("onboard status"):
        inventory = load(config)
        robots = select_robots(inventory, robot)

        def show_one(one: Robot) -> tuple[dict[str, Any], int]:
            target = open_target(one, inventory)
            try:
                facts = gather_facts(target, "robot", (UNIT_STATES, ONBOARD_STATE, CAMERA_DRIVERS))
            finally:
                target.close()
            units, state = facts.get(UNIT_STATES), facts.get(ONBOARD_STATE)
            if units is None or state is None:
                reason = facts.why_unknown(UNIT_STATES) or facts.why_unknown(ONBOARD_STATE)
                echo(f"lupin onboard status: {one.name}: {reason}", err=True)
                print_next(complete("lupin doctor", robot=one.name))
                return {"robot": one.name, "error": {"message": reason, "exit_code": NO_RESULT}}, NO_RESULT
            read = facts.values.get(CAMERA_DRIVERS.name)
            cameras = read if isinstance(read, dict) else {}  # what the cameras do is not needed to drive
            found = judge(one.name, units, state, cameras)
            if not as_json:
                _print(found, target.login_command)
            plain = found.plain()
            for problem in plain["problems"]:
                problem["next_command"] = complete(problem["next_command"], robot=one.name, login=target.login_command)
            return plain, SUCCESS if found.ready else FAILURE

        reports, code = one_after_another("onboard status", robots, show_one)
    if as_json:
        print(json.dumps(reports[0] if len(reports) == 1 else reports))
    raise typer.Exit(code)


def _print(found: Status, login: str) -> None:
    reason = f": {found.reason}" if found.reason else ""
    light = f"   (its strip shows: {found.light})" if found.light not in ("", found.doing) else ""
    echo(f"{found.robot} is {found.doing}{reason}{light}")
    echo("\nunit / process                  state                  since   memory    CPU")
    for unit in found.units:
        name = unit.name.removesuffix(".service")
        echo(_row(name, unit.state, _duration(unit.since_s), unit.memory_mb, unit.cpu_percent))
        for process in found.processes:
            if process.unit == unit.name:
                restarts = f" ({process.restarts} restarts)" if process.restarts else ""
                state = f"{process.phase}{restarts}"
                since = _duration(unit.since_s - process.up_after_s) if unit.since_s and process.up_after_s is not None else ""
                echo(_row(f"  {process.name}", state, since, process.memory_mb, process.cpu_percent))
    echo("")
    for name, text in found.devices.items():
        echo(f"{name:15} {text}")
    for problem in found.problems:
        echo(f"\n{problem.text}", err=True)
        print_next(complete(problem.next_command, robot=found.robot, login=login))
    if not found.ready and not found.problems:
        print_next(complete("lupin onboard status", robot=found.robot))  # it waits, or moves the arm home


def _row(name: str, state: str, since: str, memory_mb: float | None, percent: float | None) -> str:
    memory = "" if memory_mb is None else f"{memory_mb:.0f} MB"
    cpu = "" if percent is None else f"{percent:.1f} %"
    return f"{name:30}  {state:20} {since:>7}  {memory:>7} {cpu:>6}".rstrip()


def _duration(seconds: float | None) -> str:
    if seconds is None:
        return ""
    whole = max(0, int(seconds))
    return f"{whole} s" if whole < 120 else f"{whole // 60} min" if whole < 7200 else f"{whole // 3600} h"
