"""`lupin deploy`: install Lupin on a robot, or the laptop's part of the link on this machine; or remove either."""

from __future__ import annotations

import contextlib
import json
import threading
from typing import TYPE_CHECKING, Any

import typer

from lupin_cli.connection.options import ALL, ASK_SUDO, BREAK_LEASE, CONFIG, LIMIT, ROBOT, reporting_errors
from lupin_cli.exit_codes import FAILURE, USAGE_ERROR, worst
from lupin_cli.terminal import echo

if TYPE_CHECKING:
    from lupin_cli.connection.base import Target
    from lupin_cli.connection.inventory import Config, Robot

app = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False, no_args_is_help=True)

DRY_RUN = typer.Option(False, "--dry-run", help="Show what would change; change nothing.")
DIFF = typer.Option(False, "--diff", help="Show which files change, and the diffs of units.")
JSON = typer.Option(False, "--json", help="Print only JSON on standard output.")
YES = typer.Option(False, "--yes", "-y", help="Answer every question with yes.")
REMOVE = typer.Option(False, "--remove", help="Remove what was installed.")


@app.callback()
def root() -> None:
    """Install Lupin on a robot, or the laptop's part of the link on this machine; --remove removes either."""


@app.command("robot")
def deploy_robot(
    robot: ROBOT = None,
    every: ALL = False,
    limit: LIMIT = None,
    dry_run: bool = DRY_RUN,
    diff: bool = DIFF,
    rollback: bool = typer.Option(False, "--rollback", help="Return to the previous release."),
    remove: bool = REMOVE,
    break_lease: BREAK_LEASE = False,
    check: bool = typer.Option(True, "--check/--no-check", help="Run the doctor on the robot afterwards."),
    yes: bool = YES,
    config: CONFIG = None,
    ask_sudo: ASK_SUDO = False,
    as_json: bool = JSON,
) -> None:
    """Install this machine's release on a robot and run it: only changed files are copied, and only a complete release runs.

    Exit status: 0 done or nothing to do, 1 a step failed, or the doctor found a problem afterwards, 2 usage, 3 a robot cannot
    be reached, 130 interrupted.
    """
    if rollback and remove:
        echo("lupin deploy robot: --rollback and --remove exclude each other", err=True)
        raise typer.Exit(USAGE_ERROR)
    from lupin_cli.commands.play import ProgressPrinter, ask_operator, print_result
    from lupin_cli.connection.inventory import load as load_config
    from lupin_cli.connection.options import ask_sudo_password, open_target, select_robots
    from lupin_cli.operations.base import OperationError
    from lupin_cli.playbook import Result, play
    from lupin_cli.playbook.fleet import play_on_all

    playbook = "remove-robot" if remove else "deploy-robot"
    with reporting_errors("deploy robot"):
        inventory = load_config(config)
        robots = select_robots(inventory, robot, every=every, limit=limit)
        passwords = {one.name: ask_sudo_password(one.name) for one in robots} if ask_sudo else {}
        progress = ProgressPrinter(quiet=as_json, several=len(robots) > 1, diff=diff)
        confirm = ask_operator(yes)

        def deploy_one(each: Robot, stop: threading.Event) -> Result:
            with contextlib.closing(open_target(each, inventory, sudo_password=passwords.get(each.name))) as target:
                try:
                    variables = {} if remove else _variables(each, target, rollback)
                    return play(
                        playbook, {"robot": target}, variables, dry_run=dry_run, diff=diff,
                        confirm=confirm, on_event=progress, stop=stop, break_lease=break_lease,
                    )  # fmt: skip
                except OperationError as error:
                    return Result(playbook, each.name, "failed", message=str(error), next_command=error.next_command)

        results = play_on_all(robots, lambda each: each.name, playbook, deploy_one)
    for result in results:
        print_result(result, as_json)
    codes = [result.exit_code for result in results]
    changed = [each for each, result in zip(robots, results) if result.state == "done" and result.changed]
    problems = {each.name: _examine(each, inventory, as_json) for each in changed} if check and not (dry_run or remove) else {}
    if as_json:
        plain = [{**result.plain(), "doctor": problems.get(result.robot)} for result in results]
        print(json.dumps(plain if len(plain) != 1 else plain[0]))
    if any(problems.values()):
        codes.append(FAILURE)
        if not as_json:
            echo(
                "  next: lupin doctor --robot NAME --fix, or return to the previous release: lupin deploy robot --rollback",
                err=True,
            )
    raise typer.Exit(worst(codes))


def _variables(robot: Robot, target: Target, rollback: bool) -> dict[str, Any]:
    from lupin_cli.operations.base import OperationError
    from lupin_cli.operations.release_transfer import read_installed
    from lupin_cli.release.paths import setup_lines

    variables: dict[str, Any] = {"set_up": list(setup_lines(robot.ros_setup))}
    if rollback:
        state = read_installed(target)
        if not state.previous:
            raise OperationError(
                f"{target.name} has no release before {state.current or 'the first one'}", "lupin deploy robot"
            )
        variables["release"] = state.previous
    return variables


def _examine(robot: Robot, inventory: Config, quiet: bool) -> list[str]:
    """Run the doctor on the robot and return the ids of its problems; print all findings unless `quiet`."""
    from lupin_cli.checks.base import Severity
    from lupin_cli.checks.table import built_in
    from lupin_cli.connection.local import LocalTarget
    from lupin_cli.doctor.report import print_terminal
    from lupin_cli.doctor.session import DoctorScope, DoctorSession

    session = DoctorSession(DoctorScope(built_in(), (), LocalTarget(), robot, inventory))
    try:
        diagnosis = session.examine().diagnosis
        if not quiet:
            print_terminal(diagnosis)
        return [finding.id for finding in diagnosis.findings if finding.severity is Severity.PROBLEM]
    finally:
        session.close()


@app.command("laptop")
def deploy_laptop(
    dry_run: bool = DRY_RUN,
    diff: bool = DIFF,
    remove: bool = REMOVE,
    yes: bool = YES,
    as_json: bool = JSON,
) -> None:
    """Install the laptop's part of the link: DDS environment, NTP server, priority of the robot's WiFi.

    Exit status: 0 done or nothing to do, 1 a step failed, 2 usage, 130 interrupted.
    """
    from lupin_cli.commands.play import ProgressPrinter, ask_operator, print_result
    from lupin_cli.connection.local import LocalTarget
    from lupin_cli.playbook import play

    playbook = "remove-laptop" if remove else "deploy-laptop"
    with reporting_errors("deploy laptop"):
        result = play(
            playbook, {"laptop": LocalTarget()}, {}, dry_run=dry_run, diff=diff,
            confirm=ask_operator(yes), on_event=ProgressPrinter(quiet=as_json, several=False, diff=diff),
        )  # fmt: skip
    if as_json:
        print(json.dumps(result.plain()))
    print_result(result, as_json)
    raise typer.Exit(result.exit_code)
