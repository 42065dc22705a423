"""`lupin deploy`: a release onto a robot, the laptop's half of the link onto this machine; and both taken back."""

from __future__ import annotations

import contextlib
import json
import threading
from typing import TYPE_CHECKING, Any

import typer

from lupin_cli.robot_options import ALL, ASK_SUDO, BREAK_LEASE, CONFIG, LIMIT, ROBOT, USAGE_ERROR, reporting

if TYPE_CHECKING:
    from lupin_cli.config import Config, Robot
    from lupin_cli.target.base import Target

app = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False, no_args_is_help=True)

DRY_RUN = typer.Option(False, "--dry-run", help="Show what would change; change nothing.")
DIFF = typer.Option(False, "--diff", help="Show which files change, and how units do.")
JSON = typer.Option(False, "--json", help="Print JSON, alone on standard output.")
YES = typer.Option(False, "--yes", "-y", help="Answer every question with yes.")
REMOVE = typer.Option(False, "--remove", help="Take it off again.")


@app.callback()
def root() -> None:
    """Put Lupin onto a robot, or this machine's half of the link in place; --remove takes either back."""


@app.command("robot")
def deploy_robot(
    robot: ROBOT = None,
    every: ALL = False,
    limit: LIMIT = None,
    dry_run: bool = DRY_RUN,
    diff: bool = DIFF,
    rollback: bool = typer.Option(False, "--rollback", help="Go back to the release before."),
    remove: bool = REMOVE,
    break_lease: BREAK_LEASE = False,
    check: bool = typer.Option(True, "--check/--no-check", help="Let the doctor look at the robot afterwards."),
    yes: bool = YES,
    config: CONFIG = None,
    ask_sudo: ASK_SUDO = False,
    as_json: bool = JSON,
) -> None:
    """Put this machine's release onto a robot and run it there: only what changed travels, and nothing half-done is ever run.

    Exit status: 0 done or nothing to do, 1 a step failed, or the doctor found a problem afterwards, 2 usage, 3 a robot can't
    be reached, 130 interrupted.
    """
    if rollback and remove:
        typer.echo("lupin deploy robot: --rollback and --remove exclude each other", err=True)
        raise typer.Exit(USAGE_ERROR)
    from lupin_cli.commands.play import Shown, asking, tell_result, worst
    from lupin_cli.config import load as load_config
    from lupin_cli.operations.base import OperationError
    from lupin_cli.robot_options import ask_sudo_password, open_target, select
    from lupin_cli.runbook import Result, play
    from lupin_cli.runbook.fleet import on_all

    playbook = "remove-robot" if remove else "deploy-robot"
    with reporting("deploy robot"):
        inventory = load_config(config)
        robots = select(inventory, robot, every=every, limit=limit)
        passwords = {one.name: ask_sudo_password(one.name) for one in robots} if ask_sudo else {}
        shown, confirm = Shown(as_json, len(robots), diff), asking(yes)

        def one(each: Robot, stop: threading.Event) -> Result:
            with contextlib.closing(open_target(each, inventory, sudo_password=passwords.get(each.name))) as target:
                try:
                    variables = {} if remove else _variables(each, target, rollback)
                    return play(
                        playbook, {"robot": target}, variables, dry_run=dry_run, diff=diff,
                        confirm=confirm, on_event=shown, stop=stop, break_lease=break_lease,
                    )  # fmt: skip
                except OperationError as error:
                    return Result(playbook, each.name, "failed", message=str(error), next_command=error.next_command)

        results = on_all(robots, lambda each: each.name, playbook, one)
    for result in results:
        tell_result(result, as_json)
    codes = [result.exit_code for result in results]
    wanted = [each for each, result in zip(robots, results) if result.state == "done" and result.changed]
    found = {each.name: _doctor(each, inventory, as_json) for each in wanted} if check and not (dry_run or remove) else {}
    if as_json:
        plain = [{**result.plain(), "doctor": found.get(result.robot)} for result in results]
        print(json.dumps(plain if len(plain) != 1 else plain[0]))
    if any(found.values()):
        codes.append(1)
        if not as_json:
            typer.echo("  next: lupin doctor --robot NAME --fix, or back: lupin deploy robot --rollback", err=True)
    raise typer.Exit(worst(codes))


def _variables(robot: Robot, target: Target, rollback: bool) -> dict[str, Any]:
    from lupin_cli.onboard import set_up
    from lupin_cli.operations.base import OperationError
    from lupin_cli.release.transfer import installed

    variables: dict[str, Any] = {"set_up": list(set_up(robot.ros_setup))}
    if rollback:
        state = installed(target)
        if not state.previous:
            raise OperationError(
                f"{target.name} has no release before {state.current or 'the first one'}", "lupin deploy robot"
            )
        variables["release"] = state.previous
    return variables


def _doctor(robot: Robot, inventory: Config, quiet: bool) -> list[str]:
    """The ids of the problems that the doctor finds at the robot; all findings are printed unless `quiet`."""
    from lupin_cli.checks.base import Severity
    from lupin_cli.checks.table import built_in
    from lupin_cli.examination import Examination
    from lupin_cli.report import print_terminal
    from lupin_cli.target.local import LocalTarget

    examination = Examination(built_in(), (), LocalTarget(), robot, inventory, None)
    try:
        diagnosis = examination.examine()
        if not quiet:
            print_terminal(diagnosis)
        return [finding.id for finding in diagnosis.findings if finding.severity is Severity.PROBLEM]
    finally:
        examination.close()


@app.command("laptop")
def deploy_laptop(
    dry_run: bool = DRY_RUN,
    diff: bool = DIFF,
    remove: bool = REMOVE,
    yes: bool = YES,
    as_json: bool = JSON,
) -> None:
    """Put this machine's half of the link in place: DDS environment, clock server, priority of the robot's WiFi.

    Exit status: 0 done or nothing to do, 1 a step failed, 2 usage, 130 interrupted.
    """
    from lupin_cli.commands.play import Shown, asking, tell_result
    from lupin_cli.runbook import play
    from lupin_cli.target.local import LocalTarget

    playbook = "remove-laptop" if remove else "deploy-laptop"
    with reporting("deploy laptop"):
        result = play(
            playbook, {"laptop": LocalTarget()}, {}, dry_run=dry_run, diff=diff,
            confirm=asking(yes), on_event=Shown(as_json, 1, diff),
        )  # fmt: skip
    if as_json:
        print(json.dumps(result.plain()))
    tell_result(result, as_json)
    raise typer.Exit(result.exit_code)
